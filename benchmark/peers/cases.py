"""The recordings: arms of MuJoCo's from seeds, and real arms where their data are."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from exchange import INERTIAL, Case
from forward import ForwardWorld, Kind
from scipy.signal import butter, sosfiltfilt
from urdfs import CHAIN, write

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.identification import identify
from dvrk_gravity.recording import Recording, save_recording
from testing import lab_effects, mujoco_arms
from testing.hidden_parts import Hidden
from testing.lab_effects import left_by
from testing.lab_motion import draw_calibration, draw_other
from testing.lab_physics import AFTER, LabSensors, Truth
from testing.mujoco_world import BEFORE, DURATION, MujocoWorld, Sizes

SEED = 5200  # no other trial's
BAND = 8.0  # Hz, zero-phase: what errors are measured below
EFFECTS = (
    "payload", "link_com", "coulomb_friction", "viscous_friction", "torque_offset", "rotor_inertia",
    "elastic_cable", "torque_scale", "joint_offset", "time_delay",
)  # fmt: skip
HIDDEN_SIZES = (3.0, 6.0)  # times what the model leaves of that motion
CLEAN = 2
GAINS = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)  # N·m/A, published for the UR10e


@dataclass(frozen=True)
class Prepared:
    """A case and what the methods do not see of it.

    Attributes:
        name: Of the case.
        what: One line about it.
        case: What they see.
        effort: (N, n) measured on the test motion, unfiltered, at ``case.rate``.
        true_effort: The same without sensors; ``None`` on real arms.
        true_holding: (N, n) torque that holds the arm there; ``None`` if unknown.
        hidden: What is in each further recording.
    """

    name: str
    what: str
    case: Case
    effort: Array
    true_effort: Array | None = None
    true_holding: Array | None = None
    hidden: tuple[Hidden, ...] = ()


def low_pass(values: Array, rate: float) -> Array:
    """Return values below ``BAND`` without a shift."""
    return np.asarray(sosfiltfilt(butter(2, BAND, fs=rate, output="sos"), values, axis=0))


def even(recording: Recording, rate: float) -> Recording:
    """Return a recording on an even grid, positions and efforts only."""
    time = np.arange(recording.time[0], recording.time[-1], 1.0 / rate)
    q, effort = (
        np.stack([np.interp(time, recording.time, c) for c in values.T], axis=1)
        for values in (recording.position, recording.effort)
    )
    return Recording(recording.joints, time - time[0], q, None, effort)


def _case(folder: Path, arm: Arm, given: str, rate: float) -> Case:
    folder.mkdir(parents=True, exist_ok=True)
    why = write(arm, folder / "arm.urdf")
    limit = np.where(np.isfinite(arm.effort_limit), arm.effort_limit, 100.0)
    names = list(arm.joint_names)
    path = f"{folder / 'arm.urdf'}"
    return Case(folder, names, given, path, limit.tolist(), rate, chain_only=why)


def _save(case: Case, train: Recording, test: Recording) -> Array:
    save_recording([train], case.folder / "train.csv", "sqlite3", "/measured_js")
    q = low_pass(test.position, case.rate)
    qd = np.gradient(q, 1.0 / case.rate, axis=0)
    np.savez(case.folder / "test.npz", q=q, qd=qd, qdd=np.gradient(qd, 1.0 / case.rate, axis=0))
    content = asdict(case)
    content.pop("folder")
    (case.folder / "case.json").write_text(json.dumps(content, indent=1))
    return np.asarray(test.effort)


def _links(case: Case, engine: mujoco_arms.MujocoArm) -> dict[str, float]:
    """Return the standard parameters of the arm's links by name."""
    import pinocchio as pin

    found, model = {}, engine.model
    for joint, body in zip(case.joints, engine.bodies, strict=True):
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, model.body_iquat[body])
        turn = matrix.reshape(3, 3)
        about = turn @ np.diag(model.body_inertia[body]) @ turn.T
        row = pin.Inertia(float(model.body_mass[body]), model.body_ipos[body], about)
        found |= {f"{k}_{joint}": float(v) for k, v in
                  zip(INERTIAL, row.toDynamicParameters(), strict=True)}  # fmt: skip
    return found


def _sampled(truth: Truth, values: Array, test: Recording) -> Array:
    columns = [np.interp(test.time, truth.time, column) for column in values.T]
    return np.stack(columns, axis=1)


def laboratory(
    folder: Path, name: str, seed: int, diagnose: bool = False, *, rate: float = 200.0,
    duration: float = DURATION,
) -> Prepared:  # fmt: skip
    """Return an arm of the laboratory's: LuGre friction, cables, a spring, sensors with a delay."""
    world = MujocoWorld.draw(name, seed)
    arm = world.arm
    world = replace(world, sensors=replace(world.sensors, rate=rate))
    calibration = draw_calibration(arm, seed)
    case = _case(folder, arm, mujoco_arms.FILES.get(name, name), rate)
    train = world.record(world.truth(calibration, duration), seed)
    truth = world.truth(draw_other(arm, seed + 1, calibration))
    test = world.record(truth, seed + 1)
    still = np.zeros_like(truth.q)
    holding = (
        world.engine.torque(truth.q, still, still)
        + world.cable.torque(truth.q, truth.qd)
        + world.spring.at(truth.q)
    )
    if not case.chain_only:
        rotors = {f"Ia_{j}": float(r) for j, r in zip(case.joints, world.rotors, strict=True)}
        case = replace(case, truth=_links(case, world.engine) | rotors)
    hidden: list[Hidden] = []
    if diagnose:
        model = identify(train, arm, "joint").model  # only to say how large an effect is
        names: list[str] = []
        for number, effect in enumerate((*["nothing"] * CLEAN, *EFFECTS)):
            random = np.random.default_rng([seed, number])
            motion, noise = (int(value) for value in random.integers(1 << 30, size=2))
            other = world.truth(draw_other(arm, motion, calibration))
            left = left_by(model, world.record(other, noise))
            hiding = lab_effects.hide(world.setting(other, left), effect, random,
                                      sizes=HIDDEN_SIZES)  # fmt: skip
            names.append(f"other_{number:02d}.csv")
            save_recording([world.record(hiding.truth, noise)], folder / names[-1], "sqlite3",
                           "/measured_js")  # fmt: skip
            hidden.append(hiding.hidden)
        case = replace(case, recordings=names)
    effort = _save(case, train, test)
    what = "friction, cables, a spring and sensors that no method's terms represent exactly"
    if (rate, duration) != (200.0, DURATION):
        what = f"the arm and motion of the first, for {duration:g} s at {rate:g} Hz"
    return Prepared(folder.name, what, case, effort, _sampled(truth, truth.effort, test),
                    _sampled(truth, holding, test), tuple(hidden))  # fmt: skip


def forward(folder: Path, name: str, kind: Kind, seed: int) -> Prepared:
    """Return an arm that MuJoCo itself moves."""
    arm = mujoco_arms.arm_of(name)
    case = _case(folder, arm, mujoco_arms.FILES[name], 200.0)
    world = ForwardWorld.draw(name, kind, seed, Path(case.urdf).read_text())
    sizes, random = Sizes.of(arm), np.random.default_rng([seed, 78])
    sensors = LabSensors.draw(sizes.position_step, sizes.effort_noise, random)
    sensors = replace(sensors, rate=200.0, delay=0.0, jitter=0.0, repeated=0.0, cutoff=None)
    calibration = draw_calibration(arm, seed)
    motions = (calibration, draw_other(arm, seed + 1, calibration))
    truths = [world.truth(motion, BEFORE, DURATION, 2.0 * AFTER) for motion in motions]
    train, test = (sensors.read(truth, seed + k, "MuJoCo") for k, truth in enumerate(truths))
    own = {
        f"{kind_}_{j}": float(value)
        for kind_, row in zip(("fv", "fs", "Ia"), world.parameters, strict=True)
        for j, value in zip(case.joints, row, strict=True)
    }
    offsets = {f"off_{j}": 0.0 for j in case.joints}
    holding = None
    if kind == "friction":
        still = np.zeros_like(truths[1].q)
        holding = _sampled(truths[1], world.rigid.torque(truths[1].q, still, still), test)
        case = replace(case, truth=_links(case, world.rigid) | own | offsets)
    what = {
        "friction": "MuJoCo's own damping, frictionloss and armature, nothing else",
        "flexible": "the same, and a spring between the elbow's motor and its link",
        "backlash": "the same, and a play of half a degree either way in the elbow",
    }[kind]
    effort = _save(case, train, test)
    return Prepared(folder.name, what, case, effort,
                    _sampled(truths[1], truths[1].effort, test), holding)  # fmt: skip


def _split(recording: Recording, share: float) -> tuple[Recording, Recording]:
    at = int(share * len(recording.time))
    return tuple(
        Recording(recording.joints, recording.time[part] - recording.time[part][0],
                  recording.position[part], None, recording.effort[part])
        for part in (slice(0, at), slice(at, None))
    )  # type: ignore[return-value]  # fmt: skip


def _in_joints(recording: Recording, arm: Arm) -> Recording:
    return Recording(arm.joint_names, recording.time, arm.joint_position(recording.position), None,
                     arm.joint_effort(recording.effort))  # fmt: skip


def data_folder() -> Path:
    """Return where measured data would be."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    return Path(os.environ.get("DVRK_GRAVITY_DATA", beside))


def real(folder: Path) -> Iterator[Prepared | str]:
    """Yield the real arms, or a line that says which is left out."""
    data = data_folder()
    if not data.is_dir():
        yield f"the real UR10e, MTM and PSM: no measured data in {data} (DVRK_GRAVITY_DATA)"
        return
    urdf = data / "ur10e" / "ur10e.urdf"
    if urdf.is_file():
        arm = Arm.load(urdf)
        recording = even(Recording.load(data / "ur10e" / "ur10e_bare.csv"), 100.0)
        recording = replace(recording, effort=recording.effort * GAINS)
        case = _case(folder / "UR10e_real", arm, f"{urdf}", 100.0)
        train, test = _split(recording, 0.6)
        what = "measured; fitted on its first 60 %, judged on the rest; times made even"
        yield Prepared("UR10e_real", what, case, _save(case, train, test))
    path = data / "mtm_dynamic_30s_200hz.csv"
    if path.is_file():
        arm = Arm.load("mtmr")
        recording = _in_joints(even(Recording.load(path), 200.0), arm)
        case = _case(folder / "MTM_real", arm, "mtmr", 200.0)
        train, test = _split(recording, 0.6)
        what = "measured; the motion repeats every 11.67 s, so what is judged has been seen once"
        yield Prepared("MTM_real", what, case, _save(case, train, test))
    if (data / "psm" / "psm_one.csv").is_file():
        arm = Arm.load("psm")
        train, test = (
            _in_joints(even(Recording.load(data / "psm" / name), 200.0), arm)
            for name in ("psm_one.csv", "psm_one_bare.csv")
        )
        case = _case(folder / "PSM_real", arm, "psm", 200.0)
        what = "measured; fitted on one day, judged on the same motion recorded on a later day"
        yield Prepared("PSM_real", what, case, _save(case, train, test))


__all__ = ["CHAIN", "Prepared", "data_folder", "forward", "laboratory", "low_pass", "real"]
