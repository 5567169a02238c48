"""Diagnose real recordings from poor models to good ones, and write docs/real_data.md from it.

    python docs/real_data/story.py

Every figure and picture of that page comes from here. The recordings are no part of the
repository: their folder is ``../shared/data`` or the one that ``DVRK_GRAVITY_DATA`` names; without
it nothing is written.
"""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dvrk_gravity import Recording, TorqueModel, diagnose, gravity, identify
from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.diagnosis import FLOORS, Diagnosis, Finding
from dvrk_gravity.effects import Gravity
from dvrk_gravity.report import error_picture

FOLDER = Path(__file__).resolve().parent
PAGE = FOLDER.parent / "real_data.md"
DATA = Path(os.environ.get("DVRK_GRAVITY_DATA", FOLDER.parents[2] / "shared" / "data"))
MOTION = "mtm_dynamic_30s_200hz.csv"
SWEEP = "mtm_wrist_platform_sweep_200hz.csv"
SWEPT_AT = dict.fromkeys(JOINT_NAMES, 0.0) | dict.fromkeys(
    ("shoulder_pitch", "elbow_pitch"), np.radians(2.5)
)
POSES = ("mtmr28002_static_pos.csv", "mtmr28002_static_neg.csv")
RIGID = ("gravity", "link_inertia")
WIDTH = 118  # of a line of prose
HEAD = """# The diagnosis on real recordings

`diagnose` on measurements of real MTMs, with models that are poor on purpose and one good model.
`make story` writes this page and its pictures; the recordings are not in the repository
(`DVRK_GRAVITY_DATA` names their folder). Every error and gain is of held-out blocks. Quoted
blocks are output of the program.
"""


def main() -> int:
    """Run every step and write the page; skip where the recordings are absent."""
    missing = [name for name in (MOTION, SWEEP, *POSES) if not (DATA / name).is_file()]
    if missing:
        print(f"skipped: no {missing[0]} in {DATA} (DVRK_GRAVITY_DATA names another folder)")
        return 0
    for old in FOLDER.glob("*.svg"):
        old.unlink()
    PAGE.write_text(HEAD + "\n".join(_steps()) + "\n", encoding="utf-8")
    print(f"written: {PAGE}")
    return 0


def _steps() -> Iterator[str]:
    arm = Arm.load("mtmr")
    motion = Recording.load(DATA / MOTION, coordinates="actuator")
    rigid = identify([motion], arm, "actuator", effects=RIGID).model
    full = identify([motion], arm, "actuator").model

    wrong = Recording.load(DATA / MOTION, coordinates="joint")
    yield from _step(
        "1. Read in the wrong coordinates",
        f"The model is the rigid body alone, identified from `{MOTION}`. The file holds actuator "
        "coordinates and is read as joint coordinates. The reading is corrected before any "
        "physics.",
        diagnose(wrong, rigid), "reading", shown=1,
    )  # fmt: skip
    climbed = diagnose(motion, rigid)
    yield from _step(
        "2. Rigid body alone",
        "The same model and recording, read correctly. The model's masses, fitted without friction "
        "and springs, have absorbed part of both, and move with the findings.",
        climbed, "rigid",
        pictures=(
            ("elastic_cable", "wrist_pitch"),
            ("coulomb_friction", "elbow_pitch"),
            ("elastic_cable", "wrist_platform"),
        ),
    )  # fmt: skip
    yield from _step(
        "3. The extended model, on the same recording",
        "`extended_model.yaml` of step 2 must leave nothing to find.",
        diagnose(motion, climbed.model), "again",
    )  # fmt: skip
    sweep = Recording.load(DATA / SWEEP, coordinates="actuator")
    yield from _step(
        "4. One joint swept slowly",
        f"`{SWEEP}`: wrist_platform moves from end to end and back, no other joint moves. The "
        "rigid model again, taken as exact (without its uncertainty file), so that cable and "
        "hysteresis count as findings and not as its known error.",
        diagnose(sweep, replace(rigid, uncertainty=None), still=SWEPT_AT), "sweep",
        pictures=(("presliding_hysteresis", "wrist_platform"), ("elastic_cable", "wrist_platform")),
    )  # fmt: skip
    yield from _step(
        "5. A good model",
        f"`identify` on `{MOTION}`, all terms.",
        diagnose(motion, full), "full",
    )  # fmt: skip
    poses = [Recording.load(DATA / name) for name in POSES]
    yield from _step(
        "6. Static poses, gravity alone",
        f"`{POSES[0]}` and `{POSES[1]}`. The model is a least-squares fit of the ten entries of "
        "beta to them.",
        diagnose(poses, _gravity_alone(arm, poses)), "static",
        pictures=(("elastic_cable", "wrist_platform"), ("elastic_cable", "wrist_pitch")),
    )  # fmt: skip


def _gravity_alone(arm: Arm, poses: Sequence[Recording]) -> TorqueModel:
    columns = gravity.regressor(
        np.vstack([recording.position for recording in poses]), arm.gravity, 10
    )
    effort = np.vstack([recording.effort for recording in poses if recording.effort is not None])
    beta = np.linalg.lstsq(columns.reshape(-1, 10), effort.ravel(), rcond=None)[0]
    return TorqueModel(arm, (Gravity(arm, beta, arm.gravity),))


def _step(
    title: str,
    start: str,
    diagnosis: Diagnosis,
    name: str,
    pictures: Sequence[tuple[str, str]] = (),
    shown: int | None = None,
) -> Iterator[str]:
    """Yield the lines of one step, and save its pictures."""
    print(f"{title}: {diagnosis.verdict}", flush=True)
    yield f"\n## {title}\n"
    yield _wrapped(start) + "\n"
    yield _wrapped(f"**{diagnosis.sentence}** (verdict: `{diagnosis.verdict}`)", "> ") + "\n"
    findings = diagnosis.findings[:shown]
    if findings:
        yield "> | | finding | of the error removed, held out |"
        yield "> |---|---|---|"
        for number, finding in enumerate(findings, start=1):
            yield f"> | {number} | `{finding.effect}`: {finding.sentence} | {_gain(finding)} |"
        yield ""
    for finding in findings:
        for other in finding.alternatives:
            where = ", ".join(other.joints) or "the arm"
            yield _wrapped(
                f"`{finding.effect}` could as well be `{other.effect}` at {where}: {other.why}",
                "> - ",
            )
    for number, (effect, joint) in enumerate(pictures):
        found = next((f for f in findings if f.effect == effect and f.joints == (joint,)), None)
        if found is not None and found.picture is not None:
            path = FOLDER / f"{name}_{number}.svg"
            path.write_bytes(error_picture(found.picture, diagnosis.model.arm))
            title = f"{found.effect} at {joint}: error without and with it"
            yield f"\n![{title}](real_data/{path.name})\n"
    if shown is not None:
        return
    for note in diagnosis.notes:
        if note.startswith("rejected: ") and "not confirmed" in note:
            yield _wrapped(note, "> - ")
    for ambiguity in diagnosis.ambiguities:
        yield _wrapped(f"Ambiguous: {ambiguity.sentence}.", "> - ")
    yield from _errors(diagnosis)


def _wrapped(text: str, lead: str = "") -> str:
    """Return a paragraph in lines; "> " leads what the program says."""
    return textwrap.fill(
        text, WIDTH, initial_indent=lead, subsequent_indent=lead.replace("-", " "),
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def _gain(finding: Finding) -> str:
    gain = finding.gain
    if gain.relative == 0.0:
        return ""
    return f"{100 * gain.relative:.0f} % ({100 * gain.low:.0f} to {100 * gain.high:.0f})"


def _errors(diagnosis: Diagnosis) -> Iterator[str]:
    yield f"\nResidual, mN·m RMS; the floor is {FLOORS[diagnosis.floor_from]}:\n"
    yield "| joint | before | after | floor |"
    yield "|---|---|---|---|"
    for joint, before in diagnosis.before.items():
        if not before > 0.0:  # not recorded, or not judged
            continue
        floor = diagnosis.floor[joint]
        known = f"{1e3 * floor:.2f}" if np.isfinite(floor) else "not known"
        yield f"| {joint} | {1e3 * before:.2f} | {1e3 * diagnosis.after[joint]:.2f} | {known} |"


if __name__ == "__main__":
    sys.exit(main())
