"""The constant part of a model's torque: a spring's, a bias of the reading, or a hand's.

An effort that reads 0.3 N·m too much, and a hand that pushes steadily through a recording, look
like a spring that pulls by as much, held out or not: no motion distinguishes them. A release does:
an arm that stays where it is let go, on both sides, feels what the model commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import LinearTerm, State, constant_as_reading
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification.quality.uncertainty import dry_friction
from dvrk_gravity.identification.quality.verdict import negligible
from dvrk_gravity.identification.result import SIGNIFICANT, Constant, Holding
from dvrk_gravity.model import BIAS_IS, READING, TorqueModel, coefficients_of

# Positions that the range of each joint is averaged at. Chosen: of a polynomial of degree seven the
# mean is then right to 1e-4 of its largest.
POSITIONS = 200


def recorded_range(holding: Mapping[str, Holding]) -> Array:
    """Return (N, n) positions that fill the recorded range of each joint evenly, rad or m.

    A Latin hypercube: the mean of a function of one joint's position is its mean over the range.
    """
    random = np.random.default_rng(0)
    part = (np.arange(POSITIONS) + 0.5) / POSITIONS
    return np.stack(
        [
            each.lower + (each.upper - each.lower) * random.permutation(part)
            for each in holding.values()
        ],
        axis=1,
    )


def constants(
    model: TorqueModel, holding: Mapping[str, Holding], settled: Mapping[str, str] | None = None
) -> dict[str, Constant]:
    """Return the constant part of a model's torque by joint: the mean over the recorded range.

    Weight and friction are left out, and what the compensator does not command.

    Args:
        model: The model, with the posterior of its coefficients.
        holding: Torque at rest and recorded range, by joint.
        settled: What constants are, by joint, where that is known.
    """
    state = State.of(recorded_range(holding) - model.joint_offset)
    known = {} if model.uncertainty is None else model.uncertainty.deviations
    value, spread = np.zeros(model.arm.n), [np.zeros((model.arm.n, 1))]
    for term in model.terms:
        if not term.COMPENSATED or term.FRICTION or term.gravity_vector is not None:
            continue
        value += term.torque(state).mean(axis=0)
        if isinstance(term, LinearTerm) and term.NAME in known:
            spread.append(term.regressor(state).mean(axis=0) @ known[term.NAME])
    error = np.linalg.norm(np.concatenate(spread, axis=1), axis=1)
    least = np.maximum(dry_friction(model), negligible(model.arm))
    settled = settled or {}
    return {
        name: Constant(
            float(value[k]), float(error[k]), holding[name].torque, float(least[k]),
            settled.get(name, ""),
        )
        for k, name in enumerate(model.arm.joint_names)
    }  # fmt: skip


def stated_bias(text: str | Mapping[str, str] | None, arm: Arm) -> dict[str, str]:
    """Return what constants are by joint, from ``reading``, ``torque`` or ``JOINT=reading,…``.

    Raises:
        ConfigError: Another word, or a joint that the arm does not have.
    """
    if not text:
        return {}
    if isinstance(text, Mapping):
        text = ",".join(f"{name}={what}" for name, what in text.items())
    found: dict[str, str] = {}
    for entry in text.split(","):
        name, equals, what = entry.strip().rpartition("=")
        if what not in BIAS_IS or (equals and name not in arm.joint_names):
            expected = f"{' or '.join(BIAS_IS)}, for all joints or as JOINT={READING},…"
            raise ConfigError("--bias-is", entry.strip(), f"{expected} of {_names(arm)}")
        found |= dict.fromkeys([name] if equals else arm.joint_names, what)
    return found


def settle(
    model: TorqueModel, found: Mapping[str, Constant], stated: Mapping[str, str]
) -> TorqueModel:
    """Return the model with its constants in doubt noted, and those that are stated settled.

    A constant of the reading becomes a ``torque_offset``, which predicts the measured effort as
    before and which the compensator leaves out.

    Raises:
        ConfigError: A constant of the reading that the recordings do not determine.
    """
    arm = model.arm
    of = {name: what for name, what in stated.items() if found[name].moves}
    for name in (name for name, what in of.items() if what == READING):
        each = found[name]
        if not each.determined:
            raise ConfigError(
                "--bias-is", f"{name}={READING}",
                f"motions that determine its constant, {each.value:.2g} ± "
                f"{SIGNIFICANT * each.error:.2g} of what weight looks like, too: over more of its "
                "range",
            )  # fmt: skip
    read, doubt = (
        np.array([sizes.get(name, 0.0) for name in arm.joint_names])
        for sizes in (
            {name: found[name].value for name, what in of.items() if what == READING},
            {name: each.most for name, each in found.items() if each.in_doubt},
        )
    )
    if read.any():
        terms = constant_as_reading(arm, model.terms, read)
        uncertainty = model.uncertainty
        if uncertainty is not None:
            own = coefficients_of(terms)
            same = {name: own[name] for name in uncertainty.coefficients}
            uncertainty = replace(uncertainty, coefficients=same)
        model = replace(model, terms=terms, uncertainty=uncertainty)
    words = ", ".join(f"{name}: {what} (--bias-is)" for name, what in of.items())
    return replace(model, constant=doubt, constant_is=words)


def _names(arm: Arm) -> str:
    return ", ".join(arm.joint_names)
