"""The worked example of docs/judgement.md: prints its figures and draws its picture.

    PYTHONPATH=. python docs/judgement/example.py

A simulated MTM is identified. Then a spring is fastened to one joint, and another motion of the arm
is diagnosed with the identified model. MuJoCo computes the rigid body; friction, cables and sensors
are those of ``testing/mujoco_world.py``, which no model has exactly.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import (
    Diagnosis,
    FilteredData,
    Hypotheses,
    Posterior,
    SelectionSettings,
    build,
    infer,
    load,
    report,
)
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification import identify
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld

PICTURE = Path(__file__).resolve().with_suffix(".png")
ARM, SEED, MOTION, NOISE = "mtmr", 5, 3, 2
JOINT = "wrist_platform"
STIFFNESS, MIDDLE = 0.008, 1.8  # N·m/rad, rad
DURATION = 30.0  # s, of the motion that is diagnosed
SHOWN = 10.0  # s of it in the picture
MILLI = 1e3
NEW, MODEL, BAND = "#c0392b", "#2c3e50", "#cfd8dc"


@dataclass(frozen=True, eq=False)
class Example:
    """What the calibration left, and what a diagnosis of another motion found.

    Attributes:
        joint: Index of the joint with the spring.
        calibration: The calibration's samples.
        posterior: What explains the other motion.
        diagnosis: The findings.
    """

    joint: int
    calibration: FilteredData
    posterior: Posterior
    diagnosis: Diagnosis


def found() -> Example:
    """Identify, put on the spring, diagnose."""
    world = MujocoWorld.draw(ARM, SEED)
    joint = world.arm.joint_names.index(JOINT)
    motion = draw_calibration(world.arm, SEED)
    calibration = world.record(world.truth(motion), SEED)
    model = identify(calibration, world.arm).model

    truth = world.truth(draw_other(world.arm, MOTION, motion), DURATION)
    effort = truth.effort.copy()
    effort[:, joint] += STIFFNESS * (truth.q[:, joint] - MIDDLE)
    recording = world.record(replace(truth, effort=effort), NOISE)

    measured, faults, _ = build(recording, model)
    posterior = infer(Hypotheses.about(measured))
    diagnosis = report(posterior, faults)
    before = FilteredData.of(load([calibration], model))
    return Example(joint, before, posterior, diagnosis)


def deviation(data: FilteredData) -> Array:
    """Return (T, n) standard deviations of a model's torque: of T u and of the known error."""
    return np.sqrt(np.sum(data.model_columns**2, axis=2) + data.known_error**2)


def print_figures(example: Example) -> None:
    """Print the figures of the page."""
    joint, posterior = example.joint, example.posterior
    then, now = example.calibration, posterior.validation.data
    validation = posterior.validation
    (effect,) = posterior.selected
    candidate, trial = effect.trial.candidate, effect.trial

    def rms(values: Array, data: FilteredData) -> float:
        return float(MILLI * np.sqrt(np.mean(values[data.usable[:, joint]] ** 2)))

    print(f"spring: {MILLI * STIFFNESS:.1f} mN·m/rad about {MIDDLE:g} rad at {JOINT}")
    print(f"known error: {MILLI * now.known_error[joint]:.2f} mN·m RMS")
    print(f"samples: {len(then.residual)} at calibration, {len(now.residual)} in the new motion")
    for name, data in (("calibration", then), ("new motion", now)):
        use = data.usable[:, joint]
        error, band = data.as_read[:, joint], NORMAL_95 * deviation(data)[:, joint]
        share = float(np.mean(np.abs(error[use]) <= band[use]))
        print(
            f"{name}: residual {rms(error, data):.2f} mN·m RMS, band ±{rms(band, data):.2f} "
            f"mN·m RMS, {100 * share:.0f} % of the samples within it"
        )
    assert posterior.at_calibration is not None
    theta, _ = validation.fit([candidate])
    recurring, _ = posterior.at_calibration.spread(candidate, theta)
    of_slope = MILLI * float(np.sqrt(recurring[-1, -1])) / now.motion.travel[1][joint]
    print(f"stiffness in the calibration's residual, beyond chance: {of_slope:.1f} mN·m/rad")
    least = SelectionSettings().least(validation)[joint]
    size, smallest = MILLI * trial.size[joint], MILLI * least
    print(
        f"torque of the hypothesis: {size:.2f} mN·m RMS; the smallest that counts: {smallest:.2f}"
    )
    print(f"selection: log-likelihood +{trial.gain:.0f}, p = {trial.p_value:.0e}, corrected")
    (finding,) = example.diagnosis.findings
    gain = finding.gain
    print(
        f"held-out blocks: {100 * gain.relative:.0f} % of the error removed (95 %: "
        f"{100 * gain.low:.0f} to {100 * gain.high:.0f} %), p = {gain.p_value:.0e}"
    )
    slope = finding.parameters["stiffness"]
    low, middle, high = (MILLI * value for value in (slope.low, slope.value, slope.high))
    print(f"stiffness: {middle:.1f} mN·m/rad (95 %: {low:.1f} to {high:.1f})")
    after = validation.residual([candidate])[:, joint]
    print(f"residual with the finding: {rms(after, now):.2f} mN·m RMS")
    print(f"certainty: {finding.to_dict()['certainty']}; verdict: {example.diagnosis.verdict}")
    print(f"finding: {finding.sentence}")
    for known in example.diagnosis.known:
        if known.joints == (JOINT,):
            print(f"expected: {known.sentence}")


def picture(example: Example) -> Figure:
    """Return the four steps from the calibration's residual to the finding."""
    joint, validation = example.joint, example.posterior.validation
    then, now = example.calibration, validation.data
    (effect,) = example.posterior.selected
    candidate = effect.trial.candidate
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    (first, second), (third, fourth) = figure.subplots(2, 2)

    time = now.time - now.time[0]
    shown = time < SHOWN
    measured = now.reduce(now.motion.effort)[:, joint]
    model = measured - now.as_read[:, joint]
    band = NORMAL_95 * deviation(now)[:, joint]
    edges = (MILLI * (model + sign * band)[shown] for sign in (-1.0, 1.0))
    first.fill_between(time[shown], *edges, color=BAND, label="model, 95 % band")
    first.plot(time[shown], MILLI * model[shown], color=MODEL, linewidth=1.0, label="model")
    first.plot(time[shown], MILLI * measured[shown], color=NEW, linewidth=1.0, label="measured")
    first.set(title="1. New motion: torque", xlabel="time [s]", ylabel="torque [mN·m]")
    first.legend(fontsize=8, frameon=False)

    for axes, data, color, title in (
        (second, then, MODEL, "2. Calibration: residual"),
        (third, now, NEW, "3. New motion: residual"),
    ):
        use = data.usable[:, joint]
        q = np.degrees(data.reduce_state(data.motion.q)[use, joint])
        order = np.argsort(q)
        known = MILLI * NORMAL_95 * data.known_error[joint]
        axes.axhspan(-known, known, color=BAND, label="known error, 95 %")
        axes.plot(q[order], MILLI * data.as_read[use, joint][order], ".", color=color, markersize=2)
        axes.set(title=title, ylabel="measured - model [mN·m]")
    second.legend(fontsize=8, frameon=False)

    use = now.usable[:, joint]
    q = np.degrees(now.reduce_state(now.motion.q)[use, joint])
    order = np.argsort(q)
    theta, covariance = validation.fit([candidate])
    assert example.posterior.at_calibration is not None
    covariance = covariance + example.posterior.at_calibration.spread(candidate, theta)[0]
    columns = candidate.columns()[use, joint][order]
    torque = columns @ theta
    half = NORMAL_95 * np.sqrt(np.einsum("tk,kl,tl->t", columns, covariance, columns))
    after = validation.residual([candidate])[use, joint]
    fourth.plot(q, MILLI * after, ".", color=MODEL, markersize=2, label="residual with it")
    fourth.fill_between(q[order], MILLI * (torque - half), MILLI * (torque + half), color=BAND)
    fourth.plot(q[order], MILLI * torque, color=NEW, linewidth=1.5, label="found, 95 % band")
    true = MILLI * STIFFNESS * (np.radians(q[order]) - MIDDLE)
    fourth.plot(q[order], true, "k--", linewidth=1.0, label="true spring")
    fourth.set(title="4. Finding: torque", ylabel="torque [mN·m]")
    fourth.legend(fontsize=8, frameon=False)

    for axes in (second, third, fourth):
        axes.set_xlabel(f"position of {JOINT} [deg]")
        axes.set_xlim(second.get_xlim())
    limits = third.get_ylim()
    for axes in (second, fourth):
        axes.set_ylim(limits)
    for axes in (first, second, third, fourth):
        axes.grid(alpha=0.25)
    return figure


def main() -> int:
    """Print the figures and write the picture."""
    example = found()
    print_figures(example)
    picture(example).savefig(PICTURE, dpi=90, metadata={"Software": None})
    return 0


if __name__ == "__main__":
    sys.exit(main())
