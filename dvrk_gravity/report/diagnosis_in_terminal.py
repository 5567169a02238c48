"""A diagnosis as text for a terminal: what was found and its size, how good, what to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from dvrk_gravity.diagnosis import ERROR, FLOORS, Diagnosis, Finding
from dvrk_gravity.observation import contradiction
from dvrk_gravity.report import in_simulation
from dvrk_gravity.report.findings import (
    BETWEEN,
    KNOWN,
    SEPARATE,
    caveat,
    detectable_line,
    detectable_table,
    exact_model,
    misplaced_load,
    model_verdict,
    size_of,
    what_is_compared,
)
from dvrk_gravity.report.terminal import colorize, warning_lines, wrap
from dvrk_gravity.report.units import effort_in_table, errors_of, sizes_of


def diagnosis_text(
    diagnosis: Diagnosis, verbose: bool = False, width: int | None = None
) -> Iterator[str]:
    """Yield what a terminal shows of a diagnosis.

    Args:
        diagnosis: The result.
        verbose: Also all that the report says in words.
        width: Columns of the terminal, if there is one.
    """
    findings = diagnosis.findings
    why = contradiction(diagnosis.warnings)
    if why:
        yield wrap(why, width)
    if diagnosis.misplaced:
        yield wrap(misplaced_load(diagnosis.misplaced), width)
    if diagnosis.exact:
        yield wrap(exact_model(diagnosis.exact), width)
    if diagnosis.model_verdict:
        yield wrap(model_verdict(diagnosis.model_verdict), width)
    verdict = colorize(diagnosis.verdict.replace("_", " "), diagnosis.verdict, width)
    if not findings:
        yield wrap(diagnosis.sentence, width, f"{verdict}: ")
        if diagnosis.detectable:
            line = detectable_line(diagnosis.detectable)
            yield wrap(f"would have been found (95 %): {line}", width)
    else:
        of_what = _ambiguity_note(findings) if diagnosis.verdict == "ambiguous" else ""
        yield wrap(f"{_finding_count(findings)}{of_what}", width, f"{verdict}: ")
        yield from finding_table(findings, diagnosis.model.arm.n, width)
        for reason in diagnosis.cannot_judge:
            yield wrap(f"others may be there unseen: {reason}", width)
        yield wrap(_removed_error(diagnosis), width)
        if not why:
            yield wrap(f"next: {_largest(diagnosis).remedy or 'see the report'}", width)
        if any(diagnosis.separating(finding) for finding in findings):
            yield f"{SEPARATE}: {diagnosis.separated_by}"
    if limit := caveat(diagnosis):
        yield wrap(f"note: {limit}", width)
    suspected = [ambiguity for ambiguity in diagnosis.ambiguities if ambiguity.suspected]
    for ambiguity in suspected:
        yield wrap(f"cannot be separated: {ambiguity.sentence}", width)
        if command := diagnosis.separating(ambiguity):
            yield f"{SEPARATE}: {command}"
    for entry in diagnosis.known:
        if entry.stated:
            yield wrap(f"stated: {entry.sentence}", width)
    if diagnosis.payload_check is not None:
        yield wrap(f"known payload: {diagnosis.payload_check.sentence}", width)
    if diagnosis.outside and not verbose:
        more = f"; {len(diagnosis.outside) - 1} more" if len(diagnosis.outside) > 1 else ""
        yield wrap(f"extrapolated: {diagnosis.outside[0]}{more}", width)
    for line in warning_lines(diagnosis.warnings, verbose):
        yield wrap(line, width)
    if verbose:
        yield from (wrap(line, width) for line in _details(diagnosis))


def finding_table(findings: Sequence[Finding], n: int, width: int | None = None) -> Iterator[str]:
    """Yield a table of findings: where, what each removes of the error, certainty, and the size.

    Args:
        findings: At least one.
        n: Number of the arm's joints.
        width: Columns of the terminal, if there is one.
    """
    where = [_where(finding, n) for finding in findings]
    broad = 2 + max(len("what"), *(len(finding.effect) for finding in findings))
    wide = 2 + max(len("where"), *map(len, where))
    yield f" #  {'what':<{broad}}{'where':<{wide}}{'removes':>7}  certain  size"
    for number, (finding, place) in enumerate(zip(findings, where, strict=True), start=1):
        gain = f"{100 * finding.gain.relative:.0f} %" if finding.gain.relative else ""
        sure = "yes" if finding.certain else "no"
        head = f"{number:>2}  {finding.effect:<{broad}}{place:<{wide}}{gain:>7}  {sure:<9}"
        yield wrap(size_of(finding), width, head)
        for other in finding.alternatives:
            yield wrap(f"    or {other.effect} at {', '.join(other.joints) or 'the arm'}", width)


def _finding_count(findings: Sequence[Finding]) -> str:
    """Return how many findings there are, and how many are certain."""
    certain, of = sum(finding.certain for finding in findings), len(findings)
    if of == 1:
        return f"1 finding, {'certain' if certain else 'not certain'}"
    some = f"{certain} of them certain" if certain else "none of them certain"
    return f"{of} findings, {'certain' if certain == of else some}"


def _largest(diagnosis: Diagnosis) -> Finding:
    """Return the finding of the largest gain, a certain one if there is any.

    Of a file's masses it is the first: friction, which is in no such file, comes last.
    """
    certain = [finding for finding in diagnosis.findings if finding.certain]
    pool = certain or list(diagnosis.findings)
    return pool[0] if diagnosis.of_file else max(pool, key=lambda each: each.gain.relative)


def _ambiguity_note(findings: Sequence[Finding]) -> str:
    """Return how many findings have other explanations, which certain ones may have too."""
    several = sum(bool(finding.alternatives) for finding in findings)
    which = "" if len(findings) == 1 else f"{several} of them with "
    return f"; {which}other possible causes (see `or`)"


def _where(finding: Finding, n: int) -> str:
    """Return the joints in short, and whether it is at their motors."""
    joints = finding.joints
    if not joints:
        return "the arm"
    if len(joints) == n > 2:
        return "all joints"
    named = ", ".join(joints) if len(joints) <= 2 else f"{joints[0]}, {len(joints) - 1} more"
    return f"{named} (motor)" if finding.place == "motor" else named


def _removed_error(diagnosis: Diagnosis) -> str:
    """Return what all findings together remove, and where most error remains."""
    unit, factor, _ = effort_in_table(diagnosis.model.arm, sizes_of(diagnosis))
    before, after = diagnosis.before, diagnosis.after

    def change(joint: str) -> str:
        return f"{joint} {factor * before[joint]:.3g} -> {factor * after[joint]:.3g}"

    joints = [name for name, value in after.items() if np.isfinite(value)]
    if not joints:
        return f"errors {what_is_compared(diagnosis)} are unknown"
    most = max(joints, key=lambda name: before[name] - after[name])
    line = f"held-out RMSE before -> after, {unit}: {change(most)}"
    least, words = diagnosis.least
    above = {name: after[name] / least[name] for name in joints if least[name] > 0.0}
    if above:
        left = max(above, key=lambda name: above[name])
        line += f"; largest remaining: {change(left)}, {above[left]:.2g} times {words}"
    # Changes are shown with two digits.
    worse = [name for name in joints if float(f"{after[name]:.2g}") > float(f"{before[name]:.2g}")]
    return f"{line}; worse after: {', '.join(map(change, worse))}" if worse else line


def _details(diagnosis: Diagnosis) -> Iterator[str]:
    yield from _findings(diagnosis.findings)
    known = [entry for entry in diagnosis.known if entry.effect != ERROR and not entry.stated]
    if known:
        yield f"expected ({BETWEEN if diagnosis.against_reference else KNOWN}):"
        for entry in known:
            yield f"   {entry.sentence}"
            if entry.remedy:
                yield f"   what to do: {entry.remedy}"
    unseen = [ambiguity.pair for ambiguity in diagnosis.ambiguities if not ambiguity.suspected]
    if unseen:
        yield (
            f"no sign of these, but this data could not separate them: {'; '.join(unseen)} "
            "(numbers in the report)"
        )
    yield from _errors(diagnosis)
    if diagnosis.detectable:
        yield "would have been found, alone, with 95 %:"
        head, rows = detectable_table(diagnosis.detectable)
        wide = [2 + max(map(len, column)) for column in zip(head, *rows, strict=True)]
        for row in (head, *rows):
            yield "".join(f"{cell:<{w}}" for cell, w in zip(row, wide, strict=True)).rstrip()
    if diagnosis.in_simulation is not None:
        arm, joint = diagnosis.model.arm, _largest_gain(diagnosis.findings)
        yield from in_simulation.lines(diagnosis.in_simulation, arm, joint)
    if diagnosis.outside:
        yield "extrapolated:"
        yield from (f"   {line}" for line in diagnosis.outside)
    for note in diagnosis.notes:
        yield f"note: {note}"


def _errors(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield the table of errors by joint."""
    unit, factor, decimals = effort_in_table(diagnosis.model.arm, sizes_of(diagnosis))

    def shown(value: float) -> str:
        return f"{factor * value:9.{decimals}f}" if np.isfinite(value) else "  unknown"

    head = f"held-out RMSE [{unit}]"
    width = max(len(head), *(2 + len(joint) for joint in diagnosis.before))
    yield f"errors {what_is_compared(diagnosis)}:"
    columns = dict(zip(("before", "after", "floor", "expected"), errors_of(diagnosis), strict=True))
    legend = f"floor: {FLOORS[diagnosis.floor_from]}"
    if np.isfinite(list(diagnosis.expected.values())).any():
        legend += "; expected: "
        legend += (
            "from the uncertain masses of the file and day-to-day friction variation"
            if diagnosis.of_file
            else "the model's error at calibration"
        )
    else:
        del columns["expected"]
    yield f"{head:<{width}}" + "".join(f" {word:>9}" for word in columns)
    for joint in diagnosis.before:
        cells = "".join(f" {shown(column[joint])}" for column in columns.values())
        yield f"{f'  {joint}':<{width}}{cells}"
    yield legend


def _largest_gain(findings: Sequence[Finding]) -> str:
    """Return the joint where the first finding in the extended model gains most."""
    first = next(finding for finding in findings if finding.in_model)
    return first.joints[0] if first.picture is None else first.picture.joint


def _findings(findings: Sequence[Finding]) -> Iterator[str]:
    """Yield findings in lines; a remedy that several joints share once."""

    def shared(numbered: tuple[int, Finding]) -> tuple[object, ...]:
        number, finding = numbered
        alone = number if finding.alternatives else 0
        return finding.effect, finding.place, finding.remedy, finding.left_out, alone

    for _, group in groupby(enumerate(findings, start=1), shared):
        numbers, same = zip(*group, strict=True)
        first, last = same[0], numbers[-1]
        to = f" to {last}" if len(same) > 1 else ""
        where = ", ".join(dict.fromkeys(joint for finding in same for joint in finding.joints))
        yield f"{numbers[0]}{to}. {first.effect} at {where or 'the arm'} ({first.place})"
        yield from (f"   {finding.sentence}" for finding in same)
        if first.remedy:
            yield f"   what to do: {first.remedy}"
        for other in first.alternatives:
            yield f"   or {other.effect} at {', '.join(other.joints) or 'the arm'}: {other.why}"
        if not first.in_model and not first.unexplained:
            yield f"   (not in the extended model: {first.left_out})"
