"""This package: ``identify`` and ``diagnose`` with their defaults."""

from __future__ import annotations

import numpy as np
from exchange import INERTIAL, Case, Fitted, Parameter, run

# --- the user's lines begin ---
from dvrk_gravity import diagnose, identify


def identified(case: Case, recording: str):
    """Fit a model."""
    return identify(case.folder / recording, case.arm, "joint")


def diagnosed(case: Case, model, recording: str):
    """Find what changed."""
    return diagnose(case.folder / recording, model)


# --- the user's lines end ---
_FITS: dict[int, object] = {}


def fit(case: Case, recording: str) -> Fitted:
    """Fit, and hand over what the tables need; nothing of this is needed by a user."""
    from dvrk_gravity.effects import links_of_joints
    from dvrk_gravity.identification import base_parameters

    found = identified(case, recording)
    model = found.model
    arm = model.arm
    known, parameters = {}, []
    if not case.chain_only:
        joint_of = {body: arm.joint_names[j] for j, body in enumerate(links_of_joints(arm))}
        names = [f"{k}_{joint_of[b]}" for b in range(len(arm.body_names)) for k in INERTIAL]
        known = {
            name: {names[k]: combination[k] for k in np.flatnonzero(combination)}
            for name, _, combination in base_parameters(arm)
        }
    for parameter in found.parameters:
        if parameter.identifiable:
            low, high = parameter.ci95
            combination = known.get(parameter.name) or _own(parameter.name)
            parameters.append(
                Parameter(parameter.name, parameter.value, 0.5 * (high - low), combination)
            )
    fitted = Fitted(model.torque, parameters, _bodies(model), "", model.torque)
    _FITS[id(fitted)] = model
    return fitted


def _own(name: str) -> dict[str, float]:
    kinds = {"viscous_friction.joint": "fv", "coulomb_friction.joint": "fs",
             "rotor_inertia.motor": "Ia"}  # fmt: skip
    kind, _, rest = name.partition("[")
    return {f"{kinds[kind]}_{rest[:-1]}": 1.0} if kind in kinds and rest.endswith("]") else {}


def _bodies(model) -> dict[str, np.ndarray]:
    """Return the links as the model file has them."""
    inertia = model.term("link_inertia")
    return dict(zip(model.arm.body_names, inertia.links, strict=True)) if inertia else {}


def findings(case: Case, fitted: Fitted, recording: str) -> list[dict[str, object]]:
    """Return the findings, in order."""
    found = diagnosed(case, _FITS[id(fitted)], recording)
    return [
        {"effect": f.effect, "joint": f.joints[0] if f.joints else "", "away": float(f.certain)}
        for f in found.findings
    ]


if __name__ == "__main__":
    run(fit, findings)
