"""Readings that are not what they seem: positions and efforts in other units, or without signs."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace

import numpy as np
import pytest
from fitted import ur5_motion
from robots import PANDA

from dvrk_gravity.arms import Arm
from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.observation import held_beyond, in_their_unit, require_all
from dvrk_gravity.recording import Recording

HAND = f"{PANDA}#panda_hand"
ARM = Arm.load(HAND)
HALF = np.arange(ARM.n) >= 3


def clean() -> Recording:
    return replace(ur5_motion(file=HAND), velocity=None)


def refused(recording: Recording) -> str:
    with pytest.raises(RecordingError) as caught:
        in_their_unit(ARM, [recording])
    return str(caught.value)


WIDTH = ARM.upper - ARM.lower
RATIOS = np.linspace(30.0, 120.0, ARM.n)
POSITIONS = {
    "degrees": np.degrees,
    "servo ticks, 4096 a turn": lambda q: np.round(q * 4096 / (2.0 * np.pi) + 2048),
    "servo ticks, 1024 a turn": lambda q: np.round(q * 1024 / (2.0 * np.pi) + 512),
    "parts of the joints' ranges, -100 to 100": lambda q: (q - ARM.lower) * 200.0 / WIDTH - 100.0,
    "parts of the joints' ranges, 0 to 100": lambda q: (q - ARM.lower) * 100.0 / WIDTH,
    "turns": lambda q: q / (2.0 * np.pi),
    "gears of about 1": lambda q: 100.0 * q,
}


@pytest.mark.parametrize("words", POSITIONS)
def test_weight_and_limits_decide_what_positions_are_in(words):
    recording = clean()
    line = refused(replace(recording, position=POSITIONS[words](recording.position), arm=None))
    assert words in line
    assert "they may be" not in line


def test_positions_that_were_declared_in_degrees_and_are_none_are_refused_too():
    recording = clean()
    parts = POSITIONS["parts of the joints' ranges, -100 to 100"](recording.position)
    assert "parts of the joints' ranges" in refused(replace(recording, position=np.radians(parts)))


def test_velocities_of_the_joints_show_the_gears():
    recording = replace(ur5_motion(file=HAND), arm=None)
    assert "gears of 30, " in refused(replace(recording, position=RATIOS * recording.position))


def with_sign_bit(load: np.ndarray) -> np.ndarray:
    size = np.round(np.abs(load))
    return np.where(load < 0.0, 1024 + size, size)


def test_efforts_without_signs_are_named_and_no_mounting():
    recording = clean()
    part = 1000.0 * recording.effort / ARM.effort_limit
    for effort, words in (
        (with_sign_bit(part), "bit 10 is the sign"),
        (0.1 * with_sign_bit(-part), "from 102.4 on"),
        (np.abs(recording.effort), "magnitudes"),
        (np.round(part) % 65536, "v - 65536"),
    ):
        line = refused(replace(recording, effort=effort))
        assert words in line
        assert "base_rpy" not in line


def test_another_unit_at_some_joints_is_named_with_the_option_that_states_it():
    recording = clean()
    scale = np.where(HALF, 1000.0, 1.0)
    mixed = replace(recording, effort=scale * recording.effort, arm=None)
    assert "--effort-unit panda_joint4=mN·m,panda_joint5=mN·m" in refused(mixed)
    every = ",".join(f"{name}=mN·m" for name in np.array(ARM.joint_names)[HALF])
    stated = options.with_drive_gains(ARM, Namespace(drive_gains=None, effort_unit=every))
    np.testing.assert_allclose(mixed.of(stated).effort, recording.effort)
    assert "as stated" in in_their_unit(stated, [mixed.of(stated)])[1][0].text
    percent = np.where(HALF, 100.0 / ARM.effort_limit, 1.0)
    assert "panda_joint5=%" in refused(replace(recording, effort=percent * recording.effort))
    for wrong in ("panda_joint9=mN·m", "panda_joint1=A"):
        with pytest.raises(ConfigError, match="JOINT=mN·m"):
            options.with_drive_gains(ARM, Namespace(drive_gains=None, effort_unit=wrong))


def written(folder, recording: Recording, effort: np.ndarray, word: str = "effort"):
    """Return a CSV file whose last column of efforts has another word."""
    names = [f"{name}.{what}" for what in ("position", "effort") for name in recording.joints]
    header = ",".join(["time", *names]).removesuffix("effort") + word
    columns = np.column_stack([recording.time, recording.position, effort])
    np.savetxt(folder / "a.csv", columns, "%.17g", ",", header=header, comments="")
    return folder / "a.csv"


@pytest.mark.parametrize("value", [1.04e224, np.nan])
@pytest.mark.parametrize("joint", [1, ARM.n - 1])
def test_a_joint_that_moves_without_efforts_is_neither_absent_nor_held(value, joint, tmp_path):
    recording = clean()
    effort = np.where(np.arange(ARM.n) == joint, value, recording.effort)
    file = Recording.load(written(tmp_path, recording, effort), arm=ARM)
    with pytest.raises(RecordingError, match=f"{ARM.joint_names[joint]}: has positions, but no"):
        require_all(file, ARM, {})
    assert ARM.joint_names[joint] not in held_beyond([file], ARM, {})[0]


def test_memory_that_was_never_written_is_no_effort(tmp_path):
    effort = np.full_like(clean().effort, 2.9e-321)
    assert not Recording.load(written(tmp_path, clean(), effort), arm=ARM).effort.any()


def test_columns_that_were_not_read_are_in_the_refusal(tmp_path):
    file = written(tmp_path, clean(), clean().effort, "load")
    last = ARM.joint_names[-1]
    with pytest.raises(RecordingError, match=rf"no efforts\); columns not read: {last}\.load"):
        Recording.load(file, arm=ARM)
    file.write_text(file.read_text().replace(".effort", ".load"))
    with pytest.raises(RecordingError, match=rf"no efforts.*columns not read: .*{last}\.load"):
        require_all(Recording.load(file, arm=ARM), ARM)
