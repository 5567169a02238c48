"""What a monitor saw, as a person reads it: a sentence of each event, and a table of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arms import Arm
from dvrk_gravity.monitoring import Event, MonitorResult, MonitorSettings
from dvrk_gravity.report.findings import effect_title
from dvrk_gravity.report.terminal import wrap
from dvrk_gravity.report.units import effort_in_table
from dvrk_gravity.units import quantity

_JOINTS = 2  # of a push in its line; the JSON has all


def event_text(event: Event, arm: Arm) -> str:
    """Return an event in a sentence, without its time."""
    units = dict(zip(arm.joint_names, arm.effort_units, strict=True))
    if event.kind == "push":
        sizes = [
            f"{name} {quantity(event.values[name].value, units[name])}"
            for name in event.joints[:_JOINTS]
            if name in event.values
        ]
        lasted = "" if event.end is None else f" for {max(event.end - event.onset, 0.0):.1f} s"
        return f"push: {', '.join(sizes) or ', '.join(event.joints)}{lasted}"
    if not event.effect:
        what = {"unexplained": "unexplained torque", "drift": "drift"}.get(event.kind, event.kind)
        grown = [quantity(each.value, each.unit) for each in event.values.values()]
        return ": ".join([f"{what} at {', '.join(event.joints)}", *grown])
    effect = effects.named(event.effect)
    size = effect.summary(event.values) or ", ".join(
        f"{effect.meaning(name).label or name.replace('_', ' ')} "
        f"{effect.meaning(name).in_words(event.values[name])}"
        for name in effect.listed(event.values)
    )
    perhaps = "perhaps " if event.certainty == "perhaps" else ""
    other = [f" (or {effect_title(each.effect)} at {each.where})" for each in event.alternatives]
    return f"{perhaps}{effect_title(event.effect)} at {event.where}: {size}{''.join(other[:1])}"


def event_json(event: Event, arm: Arm) -> dict[str, Any]:
    """Return an event as a program reads it, in SI units, with its sentence."""
    values = {name: each.as_json() for name, each in event.values.items()}
    return {"sentence": event_text(event, arm), **asdict(event), "values": values}


def monitor_json(seen: MonitorResult) -> dict[str, Any]:
    """Return what a monitor saw in recordings, as a program reads it, in SI units."""
    rms, expected = _sizes(seen)
    return {
        "arm": seen.model.arm.name,
        "seconds": seen.seconds,
        "judged": seen.judged,
        "events": [event_json(event, seen.model.arm) for event in seen.events],
        "external": {
            name: {"rms": float(of), "expected": float(by)}
            for name, of, by in zip(seen.model.arm.joint_names, rms, expected, strict=True)
        },
    }


def monitor_text(seen: MonitorResult, width: int | None = None) -> Iterator[str]:
    """Yield lines on what a monitor saw in recordings.

    Args:
        seen: What it saw.
        width: Columns of the terminal, if there is one.
    """
    arm = seen.model.arm
    rms, expected = _sizes(seen)
    unit, factor, _ = effort_in_table(arm, [*rms, *expected])
    broad = 2 + max(map(len, arm.joint_names))
    yield f"{'external torque, RMS':<{broad}} {unit:>10}  expected of the model"
    for name, *sizes in zip(arm.joint_names, rms, expected, strict=True):
        shown = [f"{factor * size:.3g}" if np.isfinite(size) else "-" for size in sizes]
        yield f"{name:<{max(broad, 20)}} {shown[0]:>10} {shown[1]:>10}"
    yield ""
    span = f"{seen.judged:.0f} of {seen.seconds:.0f} s judged"
    if not seen.events:
        least = MonitorSettings().warm_up
        nothing = "nothing that the model does not expect"
        yield f"{span}: {nothing if seen.judged else f'expected {least:g} s of motion at least'}"
        return
    yield f"{span}, {len(seen.events)} event(s)"
    yield "  began  reported  what"
    for event in seen.events:
        head = f"{event.onset:7.1f} {event.reported:9.1f}  "
        yield wrap(event_text(event, arm), width, head)


def _sizes(seen: MonitorResult) -> tuple[Any, Any]:
    """Return (n,) RMS of the external torque, and of what is expected; NaN: nothing is known."""
    known = np.isfinite(seen.deviation).all(axis=1)
    if not known.any():
        nothing = np.full(seen.model.arm.n, np.nan)
        return nothing, nothing
    return tuple(
        np.sqrt(np.mean(each[known] ** 2, axis=0)) for each in (seen.external, seen.deviation)
    )
