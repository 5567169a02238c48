"""Base parameters in words: combinations of links' parameters that torque depends on."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import base_directions, samples, weight_directions
from dvrk_gravity.effects.base import rigid_body

SHOWN = 3  # parameters named in one combination
_INERTIAL = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_UNITS = ("kg", *("kg·m",) * 3, *("kg·m^2",) * 6)

# Name, unit and (parameters,) combination of each.
BaseParameters = tuple[tuple[str, str, Array], ...]


@lru_cache(maxsize=8)
def base_parameters(arm: Arm) -> BaseParameters:
    """Return name, unit and (10 bodies,) combination of the arm's base inertial parameters."""
    full = rigid_body.regressor(arm, *samples(arm), arm.gravity)
    return _base_parameters(arm, full, base_directions(arm).shape[1])


@lru_cache(maxsize=8)
def base_weights(arm: Arm) -> BaseParameters:
    """Return the same of masses and first moments, (4 bodies,), as far as they act at rest."""
    full = rigid_body.weight_regressor(arm, samples(arm)[0], arm.gravity)
    return _base_parameters(arm, full, weight_directions(arm).shape[1])


def _base_parameters(arm: Arm, full: Array, rank: int) -> BaseParameters:
    """Return the base parameters of a regressor.

    Its independent columns come from a QR with pivoting; each other column is a combination of
    those, and its parameter joins theirs (Gautier 1991; Khalil and Dombre 2002).

    Args:
        arm: The arm.
        full: (N, n, p) columns of each body's parameters, body by body.
        rank: How many combinations act.
    """
    from scipy.linalg import qr, solve_triangular

    full = full.reshape(-1, full.shape[-1])
    of_body = full.shape[-1] // len(arm.bodies)
    norm = np.linalg.norm(full, axis=0)
    norm[norm < 1e-9 * norm.max()] = np.inf
    r, order = qr(full / norm, mode="r", pivoting=True)
    depends = solve_triangular(r[:rank, :rank], r[:rank, rank:])
    found = []
    for k in range(rank):
        combination = np.zeros(full.shape[1])
        combination[order[k]] = 1.0
        finite = np.isfinite(norm[order[rank:]])
        ratio = depends[k] * np.where(finite, norm[order[rank:]], 0.0) / norm[order[k]]
        combination[order[rank:]] = np.where(np.abs(ratio) > 1e-9, ratio, 0.0)
        first = int(order[k])
        name = _combination_name(arm, combination, first, of_body)
        found.append((name, _UNITS[first % of_body], combination))
    return tuple(found)


def _combination_name(arm: Arm, combination: Array, first: int, of_body: int) -> str:
    def name(i: int) -> str:
        return f"{_INERTIAL[i % of_body]}({arm.body_names[i // of_body]})"

    others = [i for i in np.flatnonzero(combination).tolist() if i != first]
    others.sort(key=lambda i: -abs(combination[i]))
    text = name(first)
    for i in others[:SHOWN]:
        text += f" {combination[i]:+.3g} {name(i)}"
    return text + (f" + {len(others) - SHOWN} more" if len(others) > SHOWN else "")
