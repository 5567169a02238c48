"""A monitor on recordings of real arms: clean, with a known torque from a moment on, with a load.

``benchmark/monitor.py --real`` runs it. Models are identified on other recordings, or other parts.
The torques of loads are compared with what the monitor takes for external: on the PSM that of
105 g where a tape measured it, on the UR10e that of 2.805 kg at the place of the flange's frame
that fits best (three numbers for all samples), and with the difference of the same motion without
it where there is one.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
from real_trials import (
    CASES,
    DATA,
    SIZES,
    Case,
    ModelBodies,
    in_joints,
    truth_of,
    with_hidden,
)

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import LowPass, Recording
from testing import lab_effects
from testing.flights import BAND, Flight
from testing.hidden_parts import Hidden
from testing.lab_effects import Setting, left_by
from testing.monitor_judge import Monitor, Verdict, judged, table

EFFECTS = ("payload", "coulomb_friction", "elastic_cable", "joint_offset", "torque_scale")
PLACES = 3  # joints and sizes, an effect
ONSET = 0.3  # of a recording's time
REACHED = 0.01  # of the power at the joint where it is most: joints that a load reaches
PSM_PLACE = np.array([0.024, 0.535, 0.0])  # m, in the pitch link's frame, by tape


def look(monitor: Monitor, path: str | None) -> int:
    """Judge what a monitor makes of every real recording, and print the tables.

    Args:
        monitor: The monitor.
        path: Where every verdict is written as JSON.
    """
    if not DATA.is_dir():
        print(f"skipped: no {DATA} (DVRK_GRAVITY_DATA names another folder)")
        return 0
    verdicts, lines = list[Verdict](), list[str]()
    for name, prepare in CASES.items():
        if name == "mtm_reversed":  # mtm, swapped
            continue
        try:
            case = prepare()
        except ConfigError as error:
            print(f"{name}: left out: {error}", file=sys.stderr)
            continue
        model = identify(case.calibration, case.arm, case.calibration.coordinates).model
        for number, (scenario, fly) in enumerate(flights(case, model)):
            verdicts.append(judged(fly, Verdict(name, 0, number, scenario), monitor))
            print(verdicts[-1], file=sys.stderr, flush=True)
        lines += loads(case, model, monitor)
        swapped = identify(case.other, case.arm, case.other.coordinates).model
        verdict = Verdict(f"{name}, swapped", 0, 0, "clean")
        verdicts.append(judged(partial(_clean, case, case.calibration, swapped), verdict, monitor))
        print(verdicts[-1], file=sys.stderr, flush=True)
    if path:
        with open(path, "w", encoding="utf-8") as stream:
            json.dump([asdict(verdict) for verdict in verdicts], stream, indent=1)
    print(table("real recordings", verdicts))
    print("\n".join(["external torque of real loads", *lines]))
    return 0


def _clean(case: Case, recording: Recording, model: TorqueModel) -> Flight:
    none, nothing, never = np.zeros(case.arm.n), Hidden("nothing", (), {}), np.inf
    return Flight(case.name, 0, "clean", recording, model, nothing, never, never, None, none, none)


def flights(case: Case, model: TorqueModel) -> Iterator[tuple[str, Callable[[], Flight]]]:
    """Yield scenario and flight: a clean one, and known torques from a moment on."""
    recording = case.other
    assert recording.time is not None
    truth = truth_of(recording, case.arm)
    left = left_by(model, in_joints(recording, case.arm))
    at_frames = np.zeros((case.arm.n, 3))
    setting = Setting(truth, ModelBodies(model), left, case.masses, case.reach, at_frames)
    start, end = recording.time[[0, -1]].tolist()
    onset = start + ONSET * (end - start)
    after = (truth.time >= onset)[:, None]

    yield "clean", partial(_clean, case, recording, model)
    for kind, effect in enumerate(EFFECTS):
        for place in range(PLACES):

            def fly(kind: int = kind, effect: str = effect, place: int = place) -> Flight:
                random = np.random.default_rng([kind, place, 5])
                hiding = lab_effects.hide(setting, effect, random, sizes=SIZES)
                torque = np.where(after, hiding.truth.effort - truth.effort, 0.0)
                moved = np.where(after, hiding.truth.q - truth.q, 0.0)
                changed = replace(truth, q=truth.q + moved, effort=truth.effort + torque)
                shown = np.sqrt(np.mean(torque[after[:, 0]] ** 2, axis=0))
                if effect == "joint_offset":
                    shown = (
                        hiding.ratio
                        * left
                        * np.array(
                            [joint in hiding.hidden.joints for joint in case.arm.joint_names]
                        )
                    )
                return Flight(
                    case.name,
                    0,
                    effect,
                    with_hidden(recording, truth, changed),
                    model,
                    hiding.hidden,
                    onset,
                    np.inf,
                    None,
                    shown / left,
                    left,
                )

            yield effect, fly


def loads(case: Case, model: TorqueModel, monitor: Monitor) -> Iterator[str]:
    """Yield, for recordings with a load and the one without, how well the torque is recovered."""
    bare: Any = monitor(case.other, model)
    quiet = np.sqrt(np.mean(bare.external**2, axis=0))
    yield f"  {case.name} bare: external RMS {_numbers(quiet)} N·m"
    for what, recording, load in case.loads:
        seen: Any = monitor(recording, model)
        truth = truth_of(recording, case.arm)
        known = _known(case, model, truth.motion, load, seen, truth.time)
        low = LowPass(BAND, 1.0 / float(np.median(np.diff(truth.time))))
        expected = -_at(seen.time, truth.time, np.asarray(low(known)))
        fit = _fit(seen.external, expected, seen.time)
        yield f"  {case.name} {what}, beside the load's torque: {fit}"
        other = truth_of(case.other, case.arm)
        if len(other.time) == len(truth.time) and np.allclose(other.q, truth.q, atol=0.02):
            change = -_at(seen.time, truth.time, np.asarray(low(truth.effort - other.effort)))
            fit = _fit(seen.external, change, seen.time)
            yield f"  {case.name} {what}, beside the change of efforts: {fit}"


def _known(
    case: Case, model: TorqueModel, motion: tuple[Array, Array, Array], load: Hidden, seen: Any,
    time: Array,
) -> Array:  # fmt: skip
    """Return (T, n) efforts of a load: at its place, or where it explains most."""
    bodies, mass = ModelBodies(model), load.parameters["mass"]
    if case.name == "psm":
        return bodies.added(motion, 1, mass, PSM_PLACE)
    joint = case.arm.n - 1
    at_frame = bodies.added(motion, joint, mass, np.zeros(3))
    step = 0.1  # m; but for inertia, efforts are linear in the place
    columns = [
        (bodies.added(motion, joint, mass, step * axis) - at_frame) / step for axis in np.eye(3)
    ]
    shown = _at(time, seen.time, -seen.external) - at_frame
    matrix = np.stack([column.ravel() for column in columns], axis=1)
    place, *_ = np.linalg.lstsq(matrix, shown.ravel(), rcond=None)
    return at_frame + np.tensordot(place, np.stack(columns), 1)


def _fit(external: Array, expected: Array, time: Array) -> str:
    """Return R^2 of joints that the load reaches, at the lag of the monitor's filter; and others.

    Args:
        external: (N, n) what the monitor takes for external, N·m or N.
        expected: (N, n) the load's torque.
        time: (N,) s.
    """
    power = (expected**2).sum(axis=0)
    reached = power >= REACHED * power.max()
    lags = np.arange(0.0, 0.2, 0.01)
    errors = np.array(
        [((external - _at(time - lag, time, expected)) ** 2).sum(axis=0) for lag in lags]
    )
    best = int(errors[:, reached].sum(axis=1).argmin())
    error, lag = errors[best], lags[best]
    varies = ((expected - expected.mean(axis=0)) ** 2).sum(axis=0)
    each = " ".join(f"{1.0 - part:.3f}" for part in error[reached] / varies[reached])
    whole, about_zero = (1.0 - error[reached].sum() / of[reached].sum() for of in (varies, power))
    return (
        f"R^2 {whole:.4f} (about zero {about_zero:.4f}; by joint {each}; lag {1e3 * lag:.0f} ms; "
        f"joints that it does not reach: RMS {_numbers(np.sqrt(error[~reached] / len(time)))})"
    )


def _at(at: Array, time: Array, values: Array) -> Array:
    return np.stack([np.interp(at, time, column) for column in values.T], axis=1)


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.3g}" for value in values)
