"""Gravity compensation, identification and diagnosis of robot arms, the dVRK's first of all."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.diagnosis import diagnose
    from dvrk_gravity.identification import evaluate, identify
    from dvrk_gravity.model import TorqueModel
    from dvrk_gravity.recording import Recording

__all__ = ["Arm", "Recording", "TorqueModel", "diagnose", "evaluate", "identify"]

__version__ = "0.1.0"

_HOMES = {
    "Arm": "dvrk_gravity.arms",
    "TorqueModel": "dvrk_gravity.model.torque_model",
    "Recording": "dvrk_gravity.recording",
    "diagnose": "dvrk_gravity.diagnosis",
    "evaluate": "dvrk_gravity.identification",
    "identify": "dvrk_gravity.identification",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that ``--help`` need not wait for Pinocchio."""
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
