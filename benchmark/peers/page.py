"""The tables of ``docs/peers.md``, what a peer does better first."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from outcome import METHODS, US, Outcome, Row
from reasons import ELSEWHERE, reason

TITLE = "# Beside other packages"
SECTIONS = (
    "At a glance", "Where a peer is better", "What is measured", "Held-out error by joint",
    "Error of known torque", "Intervals", "Processor time and memory", "Diagnosis",
)  # fmt: skip
WIDTH = 118
LONG = "four_minutes"  # in the name of the case that is not of 30 s


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines)


def better(rows: Sequence[Row], lines: Mapping[str, int]) -> list[str]:
    """Return a sentence for every figure in which a peer is better than this package, and why."""
    found = []
    for row in rows:
        ours = row.outcomes[US]
        peers = {m: o for m, o in row.outcomes.items() if m != US and not o.failure}
        if ours.failure:
            found += [f"{row.name}: {method} has an answer where we have none ({ours.failure})"
                      for method in peers]  # fmt: skip
            continue
        figures = [(joint, ours.errors[j], {m: o.errors[j] for m, o in peers.items()})
                   for j, joint in enumerate(row.joints)]  # fmt: skip
        for name, get in (("known torque", lambda o: o.known),
                          ("holding torque", lambda o: o.holding)):  # fmt: skip
            if get(ours) is not None:
                figures.append((name, get(ours), {m: get(o) for m, o in peers.items()}))
        for name, mine, theirs in figures:
            ahead = [f"{m} {_share(e)}" for m, e in theirs.items() if _smaller(e, mine)]
            if ahead:
                line = f"{row.name}, {name}: {', '.join(ahead)}, ours {_share(mine)}."
                found.append(f"{line} {reason(row.name, name)}")
        for method, peer in peers.items():
            if peer.bodies[1] and _part(peer.bodies) > _part(ours.bodies):
                found.append(f"{row.name}: {method} has {_of(peer.bodies)} links that a body can "
                             f"have, we {_of(ours.bodies)}")  # fmt: skip
            if ours.held[1] and peer.held[1]:
                mine, theirs = (o.held[0] / o.held[1] for o in (ours, peer))
                if abs(theirs - 0.95) < abs(mine - 0.95):
                    found.append(f"{row.name}: {100 * theirs:.0f} % of {method}'s {peer.held[1]} "
                                 f"intervals hold the truth, of our {ours.held[1]} "
                                 f"{100 * mine:.0f} %. "
                                 f"{reason(row.name, 'intervals')}")  # fmt: skip
    for name, unit, of in (
        ("an identification, mean processor time", "s", lambda m: _mean(rows, m, _cpu)),
        ("an identification, mean peak memory", "GiB", lambda m: _mean(rows, m, _gib)),
        ("a diagnosis, for a peer a refit, mean processor time", "s",
         lambda m: _diagnosis_time(rows, m)),
        ("lines of the user", "", lambda m: lines[m]),
        ("hidden effects named first", "", lambda m: -_named(rows, m)[0]),
    ):  # fmt: skip
        form = "{:.2f} {}" if unit else "{}{}"
        ahead = [f"{m} {form.format(abs(of(m)), unit)}" for m in METHODS[1:] if of(m) < of(US)]
        if ahead:
            mine = form.format(abs(of(US)), unit)
            found.append(f"{name[0].upper()}{name[1:]}: {', '.join(ahead)}, ours {mine}. "
                         f"{reason('', name)}".rstrip())  # fmt: skip
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
    parts = [TITLE, textwrap.fill(how, WIDTH), f"## {SECTIONS[0]}", _summary(rows, lines)]
    parts += [f"## {SECTIONS[1]}", "\n".join(_item(line) for line in [*ahead, *ELSEWHERE])]
    parts += [f"## {SECTIONS[2]}", _MEASURED]
    parts.append("\n".join(_item(f"{row.name}: {row.what}") for row in rows))
    if notes:
        parts.append("Left out: " + "; ".join(notes) + ".")
    parts += [f"## {SECTIONS[3]}", _by_joint(rows)]
    parts += [f"## {SECTIONS[4]}", _known(rows), f"## {SECTIONS[5]}", _intervals(rows)]
    parts += [f"## {SECTIONS[6]}", _costs(rows), f"## {SECTIONS[7]}", _diagnoses(rows)]
    failed = [
        _item(f"{row.name}, {method}: {outcome.failure}")
        for row in rows for method, outcome in row.outcomes.items() if outcome.failure
    ]  # fmt: skip
    if failed:
        parts += ["## Without an answer", "\n".join(failed)]
    return "\n\n".join(parts) + "\n"


def _summary(rows: Sequence[Row], lines: Mapping[str, int]) -> str:
    """Return the one table that says most."""
    all_answered = [row for row in rows if not any(o.failure for o in row.outcomes.values())]
    known = [row for row in all_answered if row.outcomes[US].known is not None]
    long = [row for row in rows if LONG in row.name]
    short = [row for row in rows if row not in long]
    hidden = sum(effect != "nothing" for row in rows for effect, _ in row.hidden)
    clean = sum(effect == "nothing" for row in rows for effect, _ in row.hidden)
    joints = sum(len(row.joints) for row in rows)

    def held(method: str) -> str:
        inside, finite, total = (
            sum(row.outcomes[method].held[i] for row in rows if row.outcomes[US].held[2])
            for i in range(3)
        )
        if not total:
            return "-"
        return f"{_percent(inside, finite)} of {finite}" + (
            f", {total - finite} infinite" if total > finite else ""
        )

    def bodies(method: str) -> str:
        have, total = (sum(row.outcomes[method].bodies[i] for row in rows) for i in range(2))
        return _of((have, total)) if total else "-"

    def named(method: str, index: int) -> str:
        diagnosed = any(row.outcomes[method].diagnoses for row in rows)
        return f"{_named(rows, method)[index]} of {(hidden, 0, clean)[index]}" if diagnosed else "-"

    def smallest(method: str) -> str:
        count = 0
        for row in rows:
            errors = [o.errors for o in row.outcomes.values() if o.errors]
            mine = row.outcomes[method].errors
            count += sum(e <= min(column) for e, column in zip(mine, zip(*errors, strict=True),
                                                               strict=False))  # fmt: skip
        return f"{count} of {joints}"

    def mean(get: Callable[[Outcome], float | None], of: Sequence[Row]) -> Callable[[str], str]:
        return lambda m: _share(float(np.mean([get(row.outcomes[m]) for row in of]))) if of else "-"

    entries: list[tuple[str, Callable[[str], str]]] = [
        (f"held-out error over torque, mean of the {len(all_answered)} cases that all answered",
         mean(lambda o: float(np.mean(o.errors)), all_answered)),
        ("joints with the smallest error", smallest),
        (f"error of the known torque, mean of {len(known)} simulated cases",
         mean(lambda o: o.known, known)),
        ("95 % intervals that hold the truth", held),
        ("links that a body can have", bodies),
        ("hidden effects named first", lambda m: named(m, 0)),
        ("false alarms where nothing is hidden", lambda m: named(m, 2)),
        ("identification of 30 s, processor time", lambda m: f"{_mean(short, m, _cpu):.1f} s"),
        ("identification of 30 s, peak memory", lambda m: f"{_mean(short, m, _gib):.2f} GiB"),
    ]  # fmt: skip
    if long:
        entries.append(("identification of four minutes at 1 kHz",
                        lambda m: _cost(long[0].outcomes[m])))  # fmt: skip
    entries.append(("lines of the user", lambda m: str(lines[m])))
    return table(["", *METHODS], [[name, *(get(m) for m in METHODS)] for name, get in entries])


def _by_joint(rows: Sequence[Row]) -> str:
    """Return the error of every joint, the joints in the arm's order."""
    most = max(len(row.joints) for row in rows)
    cells = [
        [row.name, method, *(_errors(row, outcome) + [""] * (most - len(row.joints))),
         _mean_error(outcome)]
        for row in rows for method, outcome in row.outcomes.items()
    ]  # fmt: skip
    numbers = [f"joint {number}" for number in range(1, most + 1)]
    means = [[row.name, *(_mean_error(row.outcomes[m]) for m in METHODS)] for row in rows]
    return "\n\n".join([table(["mean of joints", *METHODS], means),
                        "Every joint, in the arm's order from its base:",
                        table(["", "", *numbers, "mean"], cells)])  # fmt: skip


_MEASURED = textwrap.dedent("""\
    Every method gets the same CSV and the same description of the arm: a URDF with its nominal
    masses. (Ours reads PSM and MTM by name, since URDF has no parallelograms.) It runs with its
    defaults, in a process of its own on one core. It then predicts the torque of another recording
    from positions that were low-passed at 8 Hz without a shift and differentiated.

    - *Error*: RMS below 8 Hz, without half a second at both ends, over the RMS of the torque.
    - *Known torque*: that of the simulation, before its sensors. *Holding*: what keeps the arm at
      rest at the recorded positions.
    - *Intervals*: those that are finite, of parameters whose truth is known.
    - *Links that a body can have*: pseudo-inertia positive definite, to 1e-7 of its greatest
      eigenvalue. Least squares: the links with its base parameters nearest to the URDF's. Ours: the
      links in the model file. figaroh without LMI has no links.
    - *Processor time*: up to the fit, with start-up and imports. *Memory*: the peak of the
      process's own resident set up to the fit.
    - *Lines*: between two markers in `benchmark/peers/ours.py`, `least_squares.py`,
      `with_figaroh.py` and `with_mujoco.py`, which also say how each is used; without blanks,
      comments and docstrings.

    The recordings:""")
_DIAGNOSED = textwrap.dedent("""\
    {count} recordings of {arms}, each with one effect hidden of 3 to 6 times what the identified
    model leaves, and {clean} with none. Ours is `diagnose`. A peer has no diagnosis: it is refitted
    to the recording, and names the parameters whose new 95 % interval excludes the old value, the
    one farthest outside first. Of a peer, any inertial parameter of the right link counts for a
    payload or a centre of mass. With nothing hidden, every name is a false alarm.""")


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
            text = f"{inside} of {finite} ({_percent(inside, finite)})" if finite else "-"
            held.append(text + (f", {total - finite} infinite" if total > finite else ""))
        if any(cell != "-" for cell in held):
            cells.append([row.name, *held])
    return table(["hold the truth", *METHODS], cells)


def _costs(rows: Sequence[Row]) -> str:
    cells = [
        [row.name, *(_cost(row.outcomes[method]) for method in METHODS)] for row in rows
    ]  # fmt: skip
    return table(["of an identification", *METHODS], cells)


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
    return "-" if outcome.failure else f"{outcome.cpu:.1f} s, {outcome.gib:.2f} GiB"


def _cpu(outcome: Outcome) -> float:
    return outcome.cpu


def _gib(outcome: Outcome) -> float:
    return outcome.gib


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / whole:.0f} %" if whole else "-"


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
    return "\n".join(textwrap.wrap(line, WIDTH, initial_indent="- ", subsequent_indent="  "))
