"""The dVRK console's JSON: read, written, checked, converted."""

from dvrk_gravity.console.file import ARMS, N_GRAVITY, N_POLYNOMIALS, N_POWERS, ConsoleFile

__all__ = ["ARMS", "N_GRAVITY", "N_POLYNOMIALS", "N_POWERS", "ConsoleFile"]
