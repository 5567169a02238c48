"""The tables of ``docs/peers.md``, what a peer does better first."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

US = "dvrk_gravity"
METHODS = (US, "least squares", "figaroh", "figaroh LMI", "mujoco.sysid")
TITLE = "# Beside other packages"
SECTIONS = (
    "What a peer does better", "What is measured", "Held-out error by joint",
    "Error of known torque", "Intervals and links", "Processor time and memory", "Lines",
    "Diagnosis",
)  # fmt: skip


@dataclass
class Outcome:
    """What a method made of a case.

    Attributes:
        errors: (n,) held-out error over torque, RMS below 8 Hz.
        known: RMS error of the torque without sensors over that torque, mean of joints.
        holding: The same of the torque that holds the arm.
        cpu: Processor seconds of the process up to the fit, start-up included.
        gib: Peak memory; NaN where it was not measured.
        held: Intervals that hold the truth, and how many are finite, and how many there are.
        bodies: Physically consistent links, and how many there are.
        without_bodies: Why there are none.
        diagnoses: One for each further recording: time and what was found.
        failure: Why there is nothing.
    """

    errors: list[float] = field(default_factory=list)
    known: float | None = None
    holding: float | None = None
    cpu: float = float("nan")
    gib: float = float("nan")
    held: tuple[int, int, int] = (0, 0, 0)
    bodies: tuple[int, int] = (0, 0)
    without_bodies: str = ""
    diagnoses: list[dict[str, Any]] = field(default_factory=list)
    failure: str = ""


@dataclass
class Row:
    """A case with what every method made of it.

    Attributes:
        name: Of the case.
        what: One line about it.
        joints: Their names.
        hidden: Effect and joint in each further recording.
        outcomes: By method.
    """

    name: str
    what: str
    joints: list[str]
    hidden: list[tuple[str, str]]
    outcomes: dict[str, Outcome]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines)


def better(rows: Sequence[Row], lines: Mapping[str, int]) -> list[str]:
    """Return a sentence for every figure in which a peer is better than this package."""
    found = []
    for row in rows:
        ours = row.outcomes[US]
        for method, peer in row.outcomes.items():
            if method == US or peer.failure:
                continue
            if ours.failure:
                found.append(
                    f"{row.name}: {method} has an answer where we have none ({ours.failure})"
                )
                continue
            ahead = [
                f"{joint} {_share(b)} against our {_share(a)}"
                for joint, a, b in zip(row.joints, ours.errors, peer.errors, strict=True)
                if _smaller(b, a)
            ]
            for name, a, b in (("torque without sensors", ours.known, peer.known),
                               ("holding torque", ours.holding, peer.holding)):  # fmt: skip
                if a is not None and b is not None and _smaller(b, a):
                    ahead.append(f"{name} {_share(b)} against {_share(a)}")
            if ahead:
                found.append(f"{row.name}, {method}, error: {'; '.join(ahead)}")
            physical = []
            if peer.bodies[1] and _part(peer.bodies) > _part(ours.bodies):
                physical.append(f"{_of(peer.bodies)} links that a body can have, ours "
                                f"{_of(ours.bodies)}")  # fmt: skip
            if ours.held[1] and peer.held[1]:
                mine, theirs = (o.held[0] / o.held[1] for o in (ours, peer))
                if abs(theirs - 0.95) < abs(mine - 0.95):
                    physical.append(f"{100 * theirs:.0f} % of {peer.held[1]} intervals hold the "
                                    f"truth, of our {ours.held[1]} {100 * mine:.0f} %")  # fmt: skip
            if physical:
                found.append(f"{row.name}, {method}: {'; '.join(physical)}")
    for method in METHODS[1:]:
        for name, unit, get in (("processor time", "s", lambda o: o.cpu),
                                ("memory", "GiB", lambda o: o.gib)):  # fmt: skip
            mine, theirs = _mean(rows, US, get), _mean(rows, method, get)
            if theirs < mine:
                found.append(
                    f"{method}, mean {name} of an identification: {theirs:.2f} {unit} against our "
                    f"{mine:.2f} {unit}"
                )
        if lines[method] < lines[US]:
            found.append(f"{method}, lines of the user: {lines[method]} against our {lines[US]}")
        named = [[_named(rows, m)[i] for m in (US, method)] for i in range(3)]
        if named[0][1] > named[0][0]:
            found.append(f"{method} names {named[0][1]} effects first, we {named[0][0]}")
        spent = [_diagnosis_time(rows, m) for m in (US, method)]
        if spent[1] < spent[0]:
            found.append(
                f"{method}, mean processor time of a diagnosis (a refit): {spent[1]:.2f} s against "
                f"our {spent[0]:.2f} s"
            )
    return found


def page(rows: Sequence[Row], lines: Mapping[str, int], notes: Sequence[str], how: str) -> str:
    """Return the page.

    Args:
        rows: The cases.
        lines: Of the user, by method.
        notes: What was left out, and why.
        how: Versions, seeds and the command.
    """
    ahead = better(rows, lines) or ["nothing in this run"]
    parts = [TITLE, how, f"## {SECTIONS[0]}", "\n".join(_item(line) for line in ahead)]
    parts += [f"## {SECTIONS[1]}", _MEASURED]
    parts.append("\n".join(_item(f"{row.name}: {row.what}") for row in rows))
    if notes:
        parts.append("Left out: " + "; ".join(notes) + ".")
    parts.append(f"## {SECTIONS[2]}")
    means = [[row.name, *(_mean_error(row.outcomes[m]) for m in METHODS)] for row in rows]
    parts.append(table(["mean of joints", *METHODS], means))
    for row in rows:
        parts.append(f"**{row.name}**")
        body = [
            [method, *_errors(row, outcome), _mean_error(outcome)]
            for method, outcome in row.outcomes.items()
        ]
        parts.append(table(["", *row.joints, "mean"], body))
    parts += [f"## {SECTIONS[3]}", _known(rows), f"## {SECTIONS[4]}", _intervals(rows)]
    parts += [f"## {SECTIONS[5]}", _costs(rows), f"## {SECTIONS[6]}"]
    parts.append(table(["", "lines"], [[m, str(lines[m])] for m in METHODS]))
    parts += [f"## {SECTIONS[7]}", _diagnoses(rows)]
    failed = [
        _item(f"{row.name}, {method}: {outcome.failure}")
        for row in rows for method, outcome in row.outcomes.items() if outcome.failure
    ]  # fmt: skip
    if failed:
        parts += ["## Without an answer", "\n".join(failed)]
    return "\n\n".join(parts) + "\n"


_MEASURED = textwrap.dedent("""\
    Every method gets the same CSV and the same description of the arm (a URDF with its nominal
    masses; ours reads PSM and MTM by their names, since URDF has no parallelograms), runs with its
    defaults in a process of its own on one core, and predicts the torque of another recording from
    positions that were low-passed at 8 Hz without a shift and differentiated. Torques are compared
    below 8 Hz, half a second at both ends left out; errors are RMS over the RMS of the torque.
    Known torque is that of the simulation before the sensors; the holding torque is what keeps the
    arm at rest at the recorded positions. An interval counts where the truth of its parameter is
    known and where it is finite. A link is physically consistent if its pseudo-inertia is positive
    definite (to 1e-7 of its greatest eigenvalue); of least squares those links with its base
    parameters that are next to the URDF's, of ours the links in the model's file. Processor time
    includes start-up and imports.
    How each peer is used, and its options: `benchmark/peers/least_squares.py`, `with_figaroh.py`,
    `with_mujoco.py`. Lines are those between two markers there, without blanks, comments and
    docstrings.""")
_DIAGNOSED = textwrap.dedent("""\
    {count} recordings of {arms}, each with one effect hidden of 3 to 6 times what the identified
    model leaves, and {clean} with none. Ours is `diagnose`; a peer, which has no diagnosis, is
    refitted to the recording, and what changed are the parameters whose new 95 % interval excludes
    the old value. Named first: ours by its first finding, a peer by the parameter farthest outside;
    any inertial parameter of the right link counts for a payload or a centre of mass. On recordings
    with nothing hidden everything named is a false alarm.""")


def _known(rows: Sequence[Row]) -> str:
    cells = []
    for row in rows:
        if all(outcome.known is None for outcome in row.outcomes.values()):
            continue
        for name, get in (("torque", lambda o: o.known), ("holding", lambda o: o.holding)):
            values = [get(row.outcomes[m]) for m in METHODS]
            if any(value is not None for value in values):
                cells.append(
                    [f"{row.name}: {name}", *("-" if v is None else _share(v) for v in values)]
                )
    return table(["mean of joints", *METHODS], cells)


def _intervals(rows: Sequence[Row]) -> str:
    cells = []
    for row in rows:
        held = []
        for method in METHODS:
            inside, finite, total = row.outcomes[method].held
            text = f"{inside} of {finite} ({100 * inside / finite:.0f} %)" if finite else "-"
            held.append(text + (f", {total - finite} infinite" if total > finite else ""))
        if any(cell != "-" for cell in held):
            cells.append([f"{row.name}: hold the truth", *held])
        links = []
        for method in METHODS:
            outcome = row.outcomes[method]
            links.append(
                _of(outcome.bodies) if outcome.bodies[1] else outcome.without_bodies or "-"
            )
        cells.append([f"{row.name}: consistent links", *links])
    return table(["", *METHODS], cells)


def _costs(rows: Sequence[Row]) -> str:
    cells = [
        [row.name, *(_cost(row.outcomes[method]) for method in METHODS)] for row in rows
    ]  # fmt: skip
    return table(["s of a core, GiB", *METHODS], cells)


def _diagnoses(rows: Sequence[Row]) -> str:
    with_others = [row for row in rows if row.hidden]
    if not with_others:
        return "Not part of this run."
    hidden = sum(effect != "nothing" for row in with_others for effect, _ in row.hidden)
    clean = sum(effect == "nothing" for row in with_others for effect, _ in row.hidden)
    arms = " and ".join(row.name for row in with_others)
    text = _DIAGNOSED.format(count=hidden, arms=arms, clean=clean)
    cells = []
    for method in METHODS:
        first, named, alarms, names = _named(with_others, method)
        if all(not row.outcomes[method].diagnoses for row in with_others):
            why = next((row.outcomes[method].failure for row in with_others
                        if row.outcomes[method].failure), "no intervals")  # fmt: skip
            cells.append([method, f"none: {why}", "-", "-", "-"])
            continue
        mean = _diagnosis_time(with_others, method)
        cells.append([method, f"{first} of {hidden}", f"{named / max(hidden, 1):.1f}",
                      f"{alarms} of {clean}, {names} names", f"{mean:.2f}"])  # fmt: skip
    head = ["", "named first", "names a recording", "false alarms", "s of a core"]
    by_effect = []
    for row in with_others:
        for number, (effect, joint) in enumerate(row.hidden):
            said = []
            for method in METHODS:
                diagnoses = row.outcomes[method].diagnoses
                found = diagnoses[number]["found"] if diagnoses else None
                said.append("-" if found is None else _first(found))
            by_effect.append([f"{row.name}: {effect} {joint}".strip(), *said])
    return "\n\n".join([text, table(head, cells), "First of what is named, and how many:",
                        table(["hidden", *METHODS], by_effect)])  # fmt: skip


def _named(rows: Sequence[Row], method: str) -> tuple[int, int, int, int]:
    """Return how many are named first, names in all, clean recordings with names, and those."""
    first = names = alarms = wrong = 0
    for row in rows:
        diagnoses = row.outcomes[method].diagnoses or [{"found": []}] * len(row.hidden)
        for (effect, joint), diagnosis in zip(row.hidden, diagnoses, strict=True):
            found = diagnosis["found"]
            if effect == "nothing":
                alarms += bool(found)
                wrong += len(found)
            else:
                names += len(found)
                first += bool(found) and fits(effect, joint, found[0], method)
    return first, names, alarms, wrong


def fits(effect: str, joint: str, found: Mapping[str, Any], method: str) -> bool:
    """Whether what is named is what was hidden; of a peer, any inertial parameter of its link."""
    inertial = ("payload", "link_com", "link_inertia")
    same = found["effect"] == effect
    if effect in inertial[:2]:
        same = found["effect"] in (inertial[:2] if method == US else inertial)
    return same and (not joint or found["joint"] == joint)


def _first(found: Sequence[Mapping[str, Any]]) -> str:
    if not found:
        return "nothing"
    return f"{found[0]['effect']} {found[0]['joint']} ({len(found)})"


def _diagnosis_time(rows: Sequence[Row], method: str) -> float:
    spent = [d["cpu"] for row in rows for d in row.outcomes[method].diagnoses]
    return float(np.mean(spent)) if spent else float("nan")


def _mean(rows: Sequence[Row], method: str, get: Callable[[Outcome], float]) -> float:
    both = [row.outcomes[method] for row in rows
            if not (row.outcomes[method].failure or row.outcomes[US].failure)]  # fmt: skip
    return float(np.mean([get(outcome) for outcome in both])) if both else float("nan")


def _errors(row: Row, outcome: Outcome) -> list[str]:
    return [_share(e) for e in outcome.errors] or ["-"] * len(row.joints)


def _mean_error(outcome: Outcome) -> str:
    return _share(float(np.mean(outcome.errors))) if outcome.errors else "-"


def _cost(outcome: Outcome) -> str:
    memory = f"{outcome.gib:.2f}" if np.isfinite(outcome.gib) else "-"
    return "-" if outcome.failure else f"{outcome.cpu:.1f} s, {memory}"


def _share(value: float) -> str:
    return f"{value:.3f}"


def _smaller(theirs: float, ours: float) -> bool:
    """As printed: less than the last digit is no difference."""
    return float(_share(theirs)) < float(_share(ours))


def _part(of: tuple[int, int]) -> float:
    return of[0] / of[1] if of[1] else 0.0


def _of(of: tuple[int, int]) -> str:
    return f"{of[0]} of {of[1]}"


def _item(line: str) -> str:
    return "\n".join(textwrap.wrap(line, 118, initial_indent="- ", subsequent_indent="  "))
