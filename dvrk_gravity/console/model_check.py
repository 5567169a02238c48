"""What is wrong with the model in a dVRK console's file: clipping, growth, pairs that cancel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import GRAVITY, JOINT_NAMES
from dvrk_gravity.arrays import Array
from dvrk_gravity.console.file import ConsoleFile, sample_torques
from dvrk_gravity.console.finding import ConsoleFinding, Severity
from dvrk_gravity.effects import DirectionalCable, evaluate
from dvrk_gravity.model import TorqueModel


@dataclass(frozen=True)
class ModelCheckSettings:
    """What is told of a console file's model. Chosen, but for the last.

    Attributes:
        tolerance: A limit counts as exceeded when the model passes it by more than this, N·m.
        serious_share: Clipping on more than this part of poses is more than a rare corner of the
            range.
        unusual_growth: Torque that a polynomial adds outside its range is told from this many times
            what it does inside…
        notable_growth: … and from this part of the joint's largest torque on,
        serious_growth: and is serious from this part on.
        wide: A limit that is wider than this many times what the model ever asks for protects
            nothing.
        pair_range: 9.81 beta1 + k2 over sixteen real arms, N·m/rad.
    """

    tolerance: float = 0.001
    serious_share: float = 0.05
    unusual_growth: float = 1.5
    notable_growth: float = 0.05
    serious_growth: float = 0.25
    wide: float = 3.0
    pair_range: tuple[float, float] = (0.30, 0.67)


SETTINGS = ModelCheckSettings()

_K2 = 16  # place of joint 2's linear coefficient among the console's parameters


def check_model(console: ConsoleFile, model: TorqueModel) -> Iterator[ConsoleFinding]:
    """Yield what the model does that it should not, within the arm's limits.

    Args:
        console: The file.
        model: Its model.
    """
    yield from _clipping(console, model)
    yield from _growth(console, model)
    yield from _pair(console, model)


def _clipping(console: ConsoleFile, model: TorqueModel) -> Iterator[ConsoleFinding]:
    """Yield safe limits that the model passes inside its range, or never comes near."""
    torques = sample_torques(model)
    over = np.maximum(torques - console.safe_upper, console.safe_lower - torques)
    for i, joint in enumerate(JOINT_NAMES):
        share = float((over[..., i] > SETTINGS.tolerance).any(axis=0).mean())
        low, high = float(console.safe_lower[i]), float(console.safe_upper[i])
        least, most = float(torques[..., i].min()), float(torques[..., i].max())
        span = f"safe limits {low:g} … {high:g} N·m"
        numbers = {"share": share, "least_Nm": least, "most_Nm": most}
        if share > 0:
            motion, pose = np.unravel_index(int(over[..., i].argmax()), over.shape[:2])
            worst = float(torques[motion, pose, i])
            text = f"{span} clip the model on {100 * share:.1f} % of poses; worst {worst:.3f} N·m"
            severity = Severity.SERIOUS if share > SETTINGS.serious_share else Severity.WARNING
            found = {**numbers, "worst_Nm": worst}
            yield ConsoleFinding("limits_clip", severity, joint, text, found)
        elif (
            SETTINGS.wide * (most - least) + 2 * SETTINGS.tolerance
            < high - low
            <= 2 * model.arm.effort_limit[i]
        ):
            text = f"{span}, but the model asks for {least:.3f} … {most:.3f}"
            yield ConsoleFinding("limits_wide", Severity.WARNING, joint, text, numbers)


def _growth(console: ConsoleFile, model: TorqueModel) -> Iterator[ConsoleFinding]:
    """Yield joints whose polynomials grow outside the calibrated range, as the console has them."""
    cable = model.term(DirectionalCable.NAME)
    if console.lower is None or not isinstance(cable, DirectionalCable):
        return
    arm = model.arm
    q = np.linspace(arm.lower, arm.upper, 2001)
    held = cable.valid.hold(q)
    # Joint 2's linear column is only half of a pair; beta1 and beta2 hold the other half.
    growth = np.zeros(len(JOINT_NAMES))
    inside = np.zeros(len(JOINT_NAMES))
    for coefficients in (cable.positive, cable.negative):
        value, edge = (_own_torque(console, coefficients, x) for x in (q, held))
        growth = np.maximum(growth, np.abs(value - edge).max(axis=0))
        inside = np.maximum(inside, np.ptp(edge, axis=0))
    for i, joint in enumerate(JOINT_NAMES):
        if growth[i] <= max(
            SETTINGS.unusual_growth * inside[i], SETTINGS.notable_growth * arm.effort_limit[i]
        ):
            continue
        severe = growth[i] > SETTINGS.serious_growth * arm.effort_limit[i]
        edges = np.degrees([cable.valid.lower[i], cable.valid.upper[i]])
        text = (
            f"outside {edges[0]:.0f} … {edges[1]:.0f} deg the torque grows by {growth[i]:.2f} N·m, "
            f"inside it changes by {inside[i]:.2f}"
        )
        numbers = {"growth_Nm": float(growth[i]), "inside_Nm": float(inside[i])}
        severity = Severity.SERIOUS if severe else Severity.WARNING
        yield ConsoleFinding("growth", severity, joint, text, numbers)


def _own_torque(console: ConsoleFile, coefficients: Array, q: Array) -> Array:
    """Return (N, 7) torques that depend on the joint's own position alone, N·m."""
    torque = evaluate(coefficients, q)
    beta1, beta2 = console.positive[:2] * GRAVITY
    torque[:, 1] += beta1 * np.sin(q[:, 1]) + beta2 * np.cos(q[:, 1])
    return torque


def _pair(console: ConsoleFile, model: TorqueModel) -> Iterator[ConsoleFinding]:
    """Yield what the file knows of beta1 and joint 2's linear column: only their sum."""
    gravity = GRAVITY * float(console.positive[0])
    linear = np.array([console.positive[_K2], console.negative[_K2]])
    if not linear.any():
        return
    sums = gravity + linear
    # Held at the edge, the linear column stops there while beta1's sine goes on.
    cable = model.term(DirectionalCable.NAME)
    growth = 0.0
    if isinstance(cable, DirectionalCable):
        q = np.linspace(model.arm.lower, model.arm.upper, 2001)
        held = cable.valid.hold(q)
        growth = float(np.abs(gravity * (np.sin(q) - np.sin(held)))[:, 1].max())
    text = (
        f"9.81 beta1 = {gravity:.2f} and k2 = {linear[0]:.2f}/{linear[1]:.2f} (up/down): only "
        f"their sum {sums[0]:.3f}/{sums[1]:.3f} N·m/rad was determined"
    )
    severity = Severity.NOTE
    if min(abs(gravity), np.abs(linear).min()) > 2 * np.abs(sums).max():
        severity = Severity.WARNING
        text += "; the two cancel"
    if growth > SETTINGS.serious_growth * model.arm.effort_limit[1]:
        severity = Severity.SERIOUS
        text += f"; with k2 held at the edge of its range, beta1 alone goes on by {growth:.2f} N·m"
    numbers = {
        "gravity_Nm": gravity, "positive_Nm_rad": float(sums[0]),
        "negative_Nm_rad": float(sums[1]), "held_growth_Nm": growth,
    }  # fmt: skip
    yield ConsoleFinding("pair", severity, JOINT_NAMES[1], text, numbers)
    low, high = SETTINGS.pair_range
    if not low <= round(sums.min(), 2) or not round(sums.max(), 2) <= high:
        text = (
            f"9.81 beta1 + k2 is {sums[0]:.3f}/{sums[1]:.3f} N·m/rad, {low:.2f} … {high:.2f} usual"
        )
        yield ConsoleFinding("pair_sum", Severity.WARNING, JOINT_NAMES[1], text, numbers)
