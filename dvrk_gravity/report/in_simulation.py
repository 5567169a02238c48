"""Two models in the simulator: a section of the report, and lines for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import DURATION, WINDOW, Drift, InSimulation
from dvrk_gravity.report.html import (
    erase,
    escape,
    inline,
    legend,
    panel,
    picture,
    side_by_side,
    table,
)
from dvrk_gravity.report.units import position_units
from dvrk_gravity.units import fixed

_BEFORE, _AFTER = "#bb3322", "#2266aa"
_LEAST_DRIFT = 0.5  # deg (or 0.9 mm), of a joint that is drawn
_MOST_DRAWN = 4


def section(result: InSimulation, arm: Arm) -> str:
    """Return the section's HTML."""
    parts = ["<h2>In the simulator</h2>"]
    if result.before is not None and result.after is not None:
        parts.append(
            f"<p>Measured efforts drive the simulated arm for {WINDOW:g} s from measured states "
            f"({result.windows} pieces of held-out motion). RMS error of the position at the end, "
            f"{_units(arm)}:</p>"
        )
        factors = _factors(arm)
        rows = _rows(factors * result.before, factors * result.after)
        parts.append(table(("", *arm.joint_names), rows))
    if result.drifts:
        first = result.drifts[0]
        parts.append(
            f"<p>If the extended model is true: largest drift in {DURATION:g} s after release at "
            f"{len(first.before)} poses, compensated as by the node, {_units(arm)}, up to the "
            "joints' stops. Friction hides most errors; a tenth of it, and of its compensation, "
            "shows them.</p>"
        )
        rows = [
            (f"{name}, {100 * drift.friction:.0f} % friction", *figures)
            for drift in result.drifts
            for name, *figures in _rows(_largest(drift.before, arm), _largest(drift.after, arm))
        ]
        parts.append(table(("", *arm.joint_names), rows))
        joints = _improved_joints(result.drifts, arm)
        if joints:
            parts.append(side_by_side(*_pictures(result.drifts, joints, arm)))
    parts += [f"<p>{escape(note)}.</p>" for note in result.notes]
    return "\n".join(parts)


def lines(result: InSimulation, arm: Arm, name: str) -> list[str]:
    """Return the results of one joint for the terminal, under a heading."""
    joint = arm.joint_names.index(name)
    text_lines = []
    if result.before is not None and result.after is not None:
        factor, unit = position_units(arm)[joint]
        text_lines.append(
            f"{name}'s position after {WINDOW:g} s is off by "
            f"{fixed(factor * result.after[joint], 2)} instead of "
            f"{fixed(factor * result.before[joint], 2)} {unit}"
        )
    for drift in result.drifts:
        before, after = _largest(drift.before, arm), _largest(drift.after, arm)
        with_friction = f"with {100 * drift.friction:.0f} % of its friction"
        if before[joint] - after[joint] > _LEAST_DRIFT:
            text_lines.append(
                f"{with_friction} {name} drifts {fixed(after[joint], 1)} "
                f"instead of {fixed(before[joint], 1)} {position_units(arm)[joint][1]} in "
                f"{DURATION:g} s"
            )
        else:
            text_lines.append(
                f"{with_friction} {name} drifts by {fixed(after[joint], 1)} "
                f"{position_units(arm)[joint][1]}, as with the given model"
            )
    condition = ", if the extended model is true" if result.drifts else ""
    return [
        f"in the simulator{condition}:",
        *(f"   {line}" for line in (*text_lines, *result.notes)),
    ]


def _largest(way: Array, arm: Arm) -> Array:
    """Return (n,) the largest drift of each joint, deg or mm."""
    return np.abs(way).max(axis=(0, 1)) * _factors(arm)


def _factors(arm: Arm) -> Array:
    return np.array([factor for factor, _ in position_units(arm)])


def _units(arm: Arm) -> str:
    return " or ".join(dict.fromkeys(unit for _, unit in position_units(arm)))


def _rows(before: Array, after: Array) -> list[tuple[str, ...]]:
    return [
        (name, *(fixed(value, 2) for value in values.tolist()))
        for name, values in (("given", before), ("extended", after))
    ]


def _improved_joints(drifts: Sequence[Drift], arm: Arm) -> list[int]:
    """Return the joints that drift less with the extended model, largest gains first.

    Those that drift in spite of friction go first; with little friction joints drag each other.
    """
    found: list[int] = []
    for drift in sorted(drifts, key=lambda drift: -drift.friction):
        gain = _largest(drift.before, arm) - _largest(drift.after, arm)
        order = np.argsort(-gain).tolist()
        found += [j for j in order if gain[j] > _LEAST_DRIFT and j not in found]
    return found[:_MOST_DRAWN]


def _pictures(drifts: Sequence[Drift], joints: Sequence[int], arm: Arm) -> Iterator[str]:
    """Yield the drift of some joints over time, for each friction."""
    figure, axes = panel()
    axes.set_xlabel("time [s]")
    for drift in drifts:
        for joint in joints:
            factor, unit = position_units(arm)[joint]
            for ways, color, label in (
                (drift.before, _BEFORE, "given model"),
                (drift.after, _AFTER, "extended"),
            ):
                lines = axes.plot(drift.time, factor * ways[:, :, joint].T, color=color)
                lines[0].set_label(label)
            axes.set_ylabel(f"drift [{unit}]")
            if not figure.legends:
                legend(figure, axes)
            title = f"{arm.joint_names[joint]}, {100 * drift.friction:.0f} % friction"
            yield picture(inline(figure), f"drift over time of {title}", title)
            erase(axes)
