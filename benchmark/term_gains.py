"""What each effect is worth on parts of a recording that a fit has not seen.

    python benchmark/term_gains.py mtm_dynamic_30s_200hz.csv --arm mtmr --coordinates actuator

A window of the recording is identified with all effects, with all but one, with the plainest
friction alone, and with links that need be no bodies; `evaluate` judges each model on the rest.
Printed is the change of |e|/|tau| by joint when something is left out, mean and standard error over
the windows: positive where it helps.
Windows overlap, so the standard errors are somewhat too small.

Printed first is by how much the windows' models differ in the torque that holds the arm at recorded
poses (RMS of the standard deviation over windows), and the standard error that they state of it.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import RigidColumns
from dvrk_gravity.identification import Fit, evaluate, identify
from dvrk_gravity.model import fitted_effects
from dvrk_gravity.recording import Coordinates, Recording

PLAIN = ("coulomb_friction", "viscous_friction", "rotor_inertia")
BODIES = "without physical consistency"
GAP = 0.5  # s between what is fitted and what is judged
SHORTEST = 4.0  # s that is judged at once
POSES = 200  # at which holding torques are compared


def part(recording: Recording, first: float, last: float) -> Recording:
    """Return the samples between two times, s from the first sample."""
    assert recording.time is not None
    time = recording.time - recording.time[0]
    rows = (time >= first) & (time < last)
    velocity = recording.velocity
    assert recording.effort is not None
    return replace(
        recording, time=recording.time[rows], position=recording.position[rows],
        velocity=None if velocity is None else velocity[rows], effort=recording.effort[rows],
    )  # fmt: skip


def errors(
    recording: Recording, arm: Arm, coordinates: Coordinates, window: tuple[float, float],
    effects: Sequence[str] | None, physical: bool = True,
) -> tuple[Fit, Array]:  # fmt: skip
    """Return a model identified within a window, and its (n,) |e|/|tau| outside."""
    assert recording.time is not None
    first, last = window
    rest = ((0.0, first - GAP), (last + GAP, float(np.ptp(recording.time))))
    fit = identify(part(recording, first, last), arm, coordinates, effects, physical=physical)
    unseen = [part(recording, *span) for span in rest if span[1] - span[0] > SHORTEST]
    judged = evaluate(fit.model, unseen, coordinates)
    return fit, np.array([error.nrmse for error in judged.joints.values()])


def differences(recording: Recording, fits: Sequence[Fit]) -> tuple[Array, Array]:
    """Return (n,) standard deviations of holding torques over windows, and those stated, N·m."""
    positions = recording.position
    if fits[0].coordinates == "actuator":
        positions = fits[0].model.arm.joint_position(positions)
    q = positions[np.random.default_rng(0).integers(0, len(positions), POSES)]
    torques = np.array([fit.model.torque(q) for fit in fits])
    stated = [[held.error for held in fit.holding.values()] for fit in fits]
    found = torques.var(axis=0, ddof=1).mean(axis=0)
    return np.sqrt(found), np.sqrt(np.mean(np.square(stated), axis=0))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recording")
    parser.add_argument("--arm", required=True)
    parser.add_argument("--coordinates", choices=("joint", "actuator"), default="joint")
    parser.add_argument("--windows", type=int, default=6)
    parser.add_argument("--part", type=float, default=0.6, help="of the recording, in a window")
    parser.add_argument("--drive-gains", type=float, nargs="+", help="if efforts are in A")
    given = parser.parse_args()
    arm, recording = Arm.of(given.arm), Recording.load(given.recording)
    if given.drive_gains:
        recording = replace(recording, effort=recording.effort * np.array(given.drive_gains))
    every = [effect for effect in fitted_effects(arm) if effect not in RigidColumns.EFFECTS]
    variants: dict[str, tuple[list[str] | None, bool]] = {BODIES: (None, False)}
    variants |= {f"without {left}": ([e for e in every if e != left], True) for left in every}
    variants[" and ".join(PLAIN)] = list(PLAIN), True
    duration = float(np.ptp(recording.time))
    starts = np.linspace(0.0, (1.0 - given.part) * duration, given.windows)
    windows = [(first, first + given.part * duration) for first in starts.tolist()]
    models = [errors(recording, arm, given.coordinates, window, None) for window in windows]
    run = [error for _, error in models]
    print(f"{'':52s}" + " ".join(f"{name[:15]:>15s}" for name in arm.joint_names))
    titles = "holding torque, between windows, N·m", "as each states, N·m"
    shown_first = differences(recording, [fit for fit, _ in models])
    for title, values in zip(titles, shown_first, strict=True):
        print(f"{title:52s}" + " ".join(f"{value:15.4f}" for value in values))
    print(
        f"{'|e|/|tau| with all':52s}" + " ".join(f"{e:15.3f}" for e in np.mean(run, axis=0)),
        flush=True,
    )
    for title, (effects, physical) in variants.items():
        change = [
            errors(recording, arm, given.coordinates, window, effects, physical)[1] - all_of_them
            for window, all_of_them in zip(windows, run, strict=True)
        ]
        mean, deviation = np.mean(change, axis=0), np.std(change, axis=0, ddof=1)
        shown = zip(mean, deviation / np.sqrt(len(change)), strict=True)
        print(f"{title:52s}" + " ".join(f"{m:+8.3f} ± {d:.3f}" for m, d in shown), flush=True)


if __name__ == "__main__":
    main()
