"""Identify a real PSM, find the mass of a weight on it, and write docs/psm.md from that.

    python docs/psm/story.py

Every figure and picture of that page comes from here. The recordings are no part of the
repository: their folder is ``../shared/data`` or the one that ``DVRK_GRAVITY_DATA`` names; without
it nothing is written.
"""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dvrk_gravity import TorqueModel, diagnose, identify
from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.diagnosis import FLOORS, Diagnosis
from dvrk_gravity.effects import Payload, State
from dvrk_gravity.identification import Evaluation, evaluate
from dvrk_gravity.recording import LowPass, Recording
from dvrk_gravity.report import what_is_compared

Array = NDArray[np.float64]

FOLDER = Path(__file__).resolve().parent
PAGE = FOLDER.parent / "psm.md"
DATA = Path(os.environ.get("DVRK_GRAVITY_DATA", FOLDER.parents[2] / "shared" / "data")) / "psm"
FITTED, BARE, LOADED = "psm_one.csv", "psm_one_bare.csv", "psm_one_105g_insertion.csv"
PLACE = "link2:0.024,0.535,0"
AS_READ = "--coordinates actuator"
# |e|/|tau| by motor of a PSM on another trajectory than the fit's, physically consistent model, by
# the authors of WPI-AIM/dvrk_dynamics_identification.
PUBLISHED = (0.093, 0.178, 0.191, 0.134, 0.239, 0.213, 0.264)
MASS, ALONG, BESIDE = 0.105, 0.535, 0.024  # kg, m: the weight, by scales and tape
WIDTH = 118  # of a line of prose
INSTRUMENT = slice(3, 7)  # motors of roll and wrist
HEAD = """# A PSM: from a recording to the mass of a tool

`make story` writes this page and its pictures from measurements of a real PSM (Classic), which
are not in the repository (`DVRK_GRAVITY_DATA` names their folder). Quoted blocks are output of
the program.

## 1. The arm as data

`config/arms/psm.yaml` holds all that the package knows of a PSM; `--arm psm` reads it.

![The mechanism at two pitches](psm/mechanism.png)

- *Remote centre.* No physical pitch axis passes through it. The chain has its pitch joint there
  all the same, since the parallelogram's loops move link 2 (the front, with the rail on it)
  exactly as if it turned there. The other parts are `followers`: `back`, which the pitch motor
  turns; `middle`; the two bars, which keep their direction; the counterweight, which moves
  against the insertion. A test compares this with MuJoCo, which has the mechanism's pins as
  equality constraints and no remote centre (`test/trials/test_psm_mechanism.py`).
- *Jaws.* They rotate by `wrist_yaw - jaw / 2` and `wrist_yaw + jaw / 2`: link 6 `follows` jaw.
- *Wrist motors.* Each drives several joints (`actuator_to_joint`). Recordings are often in motor
  coordinates (`--coordinates actuator`; by default `diagnose` detects them). Friction is sought
  at joints and at motors.
- *Not identifiable.* `back`, `middle` and link 2 rotate equally about parallel axes. Torque
  determines neither their single masses nor which of them carries a load. A load is reported on
  link 2, in its frame, whose origin is the remote centre and whose y axis points up along the
  insertion. The interval of its mass holds all bodies and places that explain the data.
"""


def main() -> int:
    """Run every step and write the page; skip where the recordings are absent."""
    missing = [name for name in (FITTED, BARE, LOADED) if not (DATA / name).is_file()]
    if missing:
        print(f"skipped: no {missing[0]} in {DATA} (DVRK_GRAVITY_DATA names another folder)")
        return 0
    draw_mechanism(Arm.load("psm"))
    PAGE.write_text(HEAD + "\n" + "\n".join(_steps()) + "\n", encoding="utf-8")
    print(f"written: {PAGE}")
    return 0


def _steps() -> Iterator[str]:
    fit = identify(DATA / FITTED, "psm", "actuator")
    model = fit.model
    bare, loaded = (evaluate(model, DATA / name, "actuator") for name in (BARE, LOADED))
    yield "\n## 2. Identification\n"
    yield f"    python -m dvrk_gravity identify {FITTED} {AS_READ} --arm psm --out psm.yaml\n"
    yield (
        "Error over torque (RMS), in motor coordinates. Held out:\n\n"
        + _quoted(f"{fit.validation}")
        + "\n"
    )
    yield "| motor | held-out phases | the same motion, a later recording | published |"
    yield "|---|---|---|---|"
    for (motor, error), published in zip(fit.held_out.items(), PUBLISHED, strict=True):
        there = bare.joints[motor].nrmse
        yield f"| {motor} | {error.nrmse:.3f} | {there:.3f} | {published:.3f} |"
    yield (
        "\nThe published errors are those of a physically consistent model by the authors of\n"
        "WPI-AIM/dvrk_dynamics_identification, on another trajectory. Verdict:\n\n"
        + _quoted(f"*{fit.verdict.level}*: {fit.verdict.reason}")
        + "\n"
    )
    scales = dict(zip(model.arm.joint_names, _scales(bare), strict=True))
    factors = [f"{scale:.2f} ({motor})" for motor, scale in list(scales.items())[INSTRUMENT]]
    yield _prose(
        f"In the later recording (`{BARE}`) the efforts of the motors of roll and wrist are "
        f"{', '.join(factors)} times the model's, plus a constant. Nearly all of that is friction "
        "of the instrument, which varies from day to day. The diagnosis expects this variation, "
        "with a standard deviation of 30 %."
    )
    yield "## 3. The same motion again: what changed?\n"
    yield f"    python -m dvrk_gravity diagnose {BARE} {AS_READ} --model psm.yaml --out out\n"
    yield from _shown(diagnose(DATA / BARE, model, coordinates="actuator"))
    yield "## 4. A weight of 105 g\n"
    yield _prose(
        f"`{LOADED}` is that motion with a weight of {1e3 * MASS:.0f} g clamped on, its centre "
        f"{1e2 * ALONG:.1f} cm from the remote centre along the insertion and "
        f"{1e2 * BESIDE:.1f} cm beside it, by tape."
    )
    yield f"    python -m dvrk_gravity diagnose {LOADED} {AS_READ} --model psm.yaml --out out\n"
    diagnosis = diagnose(DATA / LOADED, model, coordinates="actuator")
    yield from _shown(diagnosis)
    yield from _compared(diagnosis)
    yield ""
    yield _prose(
        "Most of the width of the mass's interval comes from springs, which may have changed by a "
        "tenth of a joint's torque since calibration; next comes the model's known error, part of "
        "which may look like a load. Noise contributes little, so a longer recording does not "
        "help. A faster motion shows more inertia; a stated place (section 6) needs none."
    )
    draw_weight(model, loaded)
    yield "![What the model leaves, and the torque of the weight](psm/weight.png)\n"
    sliding = _sliding(model, loaded)
    yield _prose(
        "The weight is on link 2 and not on the sliding carriage. There, the insertion's effort "
        f"would differ from the model's by {sliding[1]:.2f} N on average; it differs by "
        f"{sliding[0]:.2f} N."
    )
    yield "## 5. The same weight, without a model\n"
    yield (
        f"    python -m dvrk_gravity diagnose {LOADED} {AS_READ} --arm psm \\\n"
        f"      --reference {BARE} --out out\n"
    )
    yield from _against_references()
    yield from _at_the_place(model)


def _at_the_place(model: TorqueModel) -> Iterator[str]:
    """Yield what the weight weighs at its place, by the model and by difference."""
    yield "\n## 6. The mass at its known place\n"
    yield f"    python -m dvrk_gravity diagnose {LOADED} {AS_READ} \\"
    yield f"      --model psm.yaml --payload-at {PLACE} --out out\n"
    yield "| compared with | mass, g | 95 % | by scales |"
    yield "|---|---|---|---|"
    arm, place = Arm.load("psm"), {"coordinates": "actuator", "payload_at": PLACE}
    for name, found in (
        ("the model", diagnose(DATA / LOADED, model, **place)),
        (f"`{BARE}`", diagnose(DATA / LOADED, arm=arm, reference=DATA / BARE, **place)),
    ):
        print(found.sentence, flush=True)
        payload = next(finding for finding in found.findings if finding.effect == Payload.NAME)
        mass = payload.parameters["mass"]
        interval = f"{1e3 * mass.low:.0f} to {1e3 * mass.high:.0f}"
        yield f"| {name} | {1e3 * mass.value:.1f} | {interval} | {1e3 * MASS:.0f} |"


def _against_references() -> Iterator[str]:
    """Yield the weight that is found against either recording without it."""
    head = "| reference | mass, g | 95 % | mass times place along the insertion, g·m | 95 % |"
    yield f"{head} other findings |"
    yield "|---|---|---|---|---|---|"
    yield f"| by scales and tape | {1e3 * MASS:.0f} | | {1e3 * MASS * ALONG:.1f} | | |"
    for name in (BARE, FITTED):
        found = diagnose(DATA / LOADED, arm="psm", coordinates="actuator", reference=DATA / name)
        print(found.sentence, flush=True)
        payload = next(finding for finding in found.findings if finding.effect == Payload.NAME)
        mass, moment = (payload.parameters[key] for key in ("mass", "first_moment_y"))
        beside = ", ".join(
            f"{finding.effect} ({', '.join(finding.joints)})"
            for finding in found.findings
            if finding.effect != Payload.NAME
        )
        yield (
            f"| `{name}` | {1e3 * mass.value:.0f} | {1e3 * mass.low:.0f} to {1e3 * mass.high:.0f} "
            f"| {1e3 * moment.value:.1f} | {1e3 * moment.low:.1f} to {1e3 * moment.high:.1f} "
            f"| {beside} |"
        )
    far, near, beyond = _pitch_of_days()
    yield "\n" + _prose(
        "On a link that rotates about a point, weight determines mass times distance, and only "
        "inertia determines mass times distance squared. The mass is the square of the first "
        "over the second: an inertia that is 8 % too large makes the mass 8 % too small. Other "
        "things changed as well. Without the weight, between two recordings of one motion "
        f"(`{FITTED}`, `{BARE}`), pitch's effort differs by {far:.2f} N·m RMS beyond {beyond:.2f} "
        f"rad and by {near:.2f} N·m elsewhere. With a model, that is part of its known error. "
        "Against a baseline, springs may differ by a tenth of their torque, a size chosen with "
        "these recordings. Other differences are reported with the weight: make both "
        "recordings in one session. A faster motion would determine the mass better."
    ).rstrip("\n")


def _prose(text: str) -> str:
    """Return a paragraph in lines, and a blank line."""
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False) + "\n"


def _quoted(text: str, bullet: str = "") -> str:
    """Return what the program says, as a quotation."""
    return textwrap.fill(
        text, WIDTH, initial_indent=f"> {bullet}", subsequent_indent="> " + " " * len(bullet),
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def _pitch_of_days() -> tuple[float, float, float]:
    """Return RMS differences of pitch's efforts in its uppermost fifth and below, and where."""
    first, second = (Recording.load(DATA / name, coordinates="actuator") for name in (FITTED, BARE))
    assert first.effort is not None
    assert second.effort is not None
    change = LowPass(5.0, 200.0)(second.effort[:, 1:2] - first.effort[:, 1:2])[:, 0]
    beyond = float(np.percentile(first.position[:, 1], 80.0))
    above = first.position[:, 1] > beyond
    far, near = (float(np.sqrt(np.mean(change[rows] ** 2))) for rows in (above, ~above))
    return far, near, beyond


def _scales(result: Evaluation) -> Array:
    """Return (n,) factors from predicted to measured efforts, a constant beside them."""
    (trace,) = result.traces
    return np.array(
        [
            np.polyfit(predicted, measured, 1)[0]
            for predicted, measured in zip(trace.predicted.T, trace.measured.T, strict=True)
        ]
    )


def _shown(diagnosis: Diagnosis) -> Iterator[str]:
    print(diagnosis.verdict, flush=True)
    yield _quoted(f"**{diagnosis.sentence}** (verdict: `{diagnosis.verdict}`)")
    for number, finding in enumerate(diagnosis.findings, start=1):
        yield _quoted(f"{finding.effect} ({finding.place}): {finding.sentence}", f"{number}. ")
    for known in diagnosis.known:
        if "RMS" not in known.sentence:
            yield _quoted(f"known: {known.sentence}", "- ")
    floor = FLOORS[diagnosis.floor_from]
    yield "\n" + _prose(f"Residual, RMS, {what_is_compared(diagnosis)}; the floor is {floor}:")
    yield "| joint | before | after | floor | expected of the model |"
    yield "|---|---|---|---|---|"
    for joint, before in diagnosis.before.items():
        row = (before, diagnosis.after[joint], diagnosis.floor[joint], diagnosis.expected[joint])
        yield f"| {joint} | " + " | ".join(f"{1e3 * rmse:.1f}" for rmse in row) + " |"
    yield "\n(mN·m; insertion: mN)\n"


def _compared(diagnosis: Diagnosis) -> Iterator[str]:
    found = next(finding for finding in diagnosis.findings if finding.effect == Payload.NAME)
    yield "| | found | 95 % | by scales and tape |"
    yield "|---|---|---|---|"
    rows: Mapping[str, tuple[str, float]] = {
        "mass": ("mass, g", MASS), "y": ("along the insertion, mm", ALONG),
        "x": ("beside it, mm", BESIDE),
    }  # fmt: skip
    for name, (words, truth) in rows.items():
        estimate = found.parameters[name]
        value, low, high, known = (
            1e3 * part for part in (estimate.value, estimate.low, estimate.high, truth)
        )
        yield f"| {words} | {value:.0f} | {low:.0f} to {high:.0f} | {known:.0f} |"


def _torque_of_weight(model: TorqueModel, result: Evaluation, link: str, com: Array) -> Array:
    """Return (N, n) torques of the weight on a link along a recording, its inertia included."""
    (trace,) = result.traces
    assert trace.time is not None
    assert trace.velocity is not None
    weight = Payload(model.arm, link, MASS, MASS * com, model.arm.gravity)
    q, qd = (model.arm.joint_position(values) for values in (trace.position, trace.velocity))
    qdd = np.gradient(qd, trace.time, axis=0)
    return model.arm.actuator_effort(weight.torque(State(q, qd, qdd)))


def _sliding(model: TorqueModel, result: Evaluation) -> tuple[float, float]:
    """Return how the insertion's effort differs from the model's, and would if it carried it."""
    (trace,) = result.traces
    residual = trace.measured[:, 2] - trace.predicted[:, 2]
    slid = _torque_of_weight(model, result, "link3", np.array([0.0, 0.0, 0.4318 - ALONG]))
    return float(np.mean(residual)), float(np.mean(slid[:, 2]))


def draw_weight(model: TorqueModel, result: Evaluation) -> None:
    """Save a picture of what the model leaves beside the torque of the weight."""
    (trace,) = result.traces
    assert trace.time is not None
    torque = _torque_of_weight(model, result, "link2", np.array([BESIDE, ALONG, 0.0]))
    figure = Figure(figsize=(8.0, 4.5), layout="constrained")
    for joint, axes in enumerate(figure.subplots(2, 1, sharex=True)):
        name = model.arm.joint_names[joint]
        axes.plot(trace.time, trace.measured[:, joint] - trace.predicted[:, joint], lw=1.0,
                  label="measured minus model")  # fmt: skip
        axes.plot(trace.time, torque[:, joint], lw=1.0, label="weight of 105 g, place by tape")
        axes.set_ylabel(f"{name} [N·m]")
    axes.set_xlim(0.0, 13.0)
    axes.set_xlabel("time [s]")
    axes.legend(loc="upper right", fontsize=8)
    figure.savefig(FOLDER / "weight.png", dpi=110)


def draw_mechanism(arm: Arm) -> None:
    """Save a picture of the mechanism, seen along the pitch axis, at two pitches."""
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    for axes, pitch in zip(
        figure.subplots(1, 2, sharex=True, sharey=True), (0.0, 30.0), strict=True
    ):
        q = np.zeros(arm.n)
        q[1], q[2] = np.radians(pitch), 0.12
        tree = build_tree(arm, {}, arm.gravity)
        pin.forwardKinematics(tree.model, tree.data, tree.expand @ q)
        frames = {
            body.name: tree.data.oMi[i] * body.frame for i, body in enumerate(arm.bodies, start=1)
        }

        at = {name: frame.translation for name, frame in frames.items()}
        low, high = (
            frames[name].act(np.array([0, 0.516, 0])) for name in ("lower_bar", "upper_bar")
        )
        lines = {
            "back": [at["back"], at["lower_bar"], at["upper_bar"]],
            "lower_bar": [at["lower_bar"], low],
            "upper_bar": [at["upper_bar"], high],
            "middle": [np.array([0, -0.516 + 0.096, 0]),
                       frames["upper_bar"].act(np.array([0, 0.096, 0]))],
            "link2": [low, high, frames["link2"].act(np.array([0, 0.45, 0]))],
            "counterweight": [at["counterweight"]],
            "link3, link4": [at["link3"], at["link4"]],
        }  # fmt: skip
        for name, points in lines.items():
            y, z = 1e2 * np.array(points).T[1:]
            axes.plot(y, z, "-", marker="s" if len(points) == 1 else "o", ms=4, lw=2, label=name)
        axes.plot(0, 0, "k*", ms=12, label="remote centre")
        axes.plot([-60, 10], [0, 0], "k:", lw=1, label="yaw axis")
        axes.set_title(f"pitch {pitch:.0f} deg")
        axes.set_aspect("equal")
        axes.set_xlabel("y of the base [cm]")
    figure.axes[0].set_ylabel("z of the base [cm]")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right", fontsize=8)
    figure.savefig(FOLDER / "mechanism.png", dpi=110)


if __name__ == "__main__":
    sys.exit(main())
