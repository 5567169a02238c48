"""Measured recordings: what is found in them, bags beside the CSV."""

from __future__ import annotations

import numpy as np
import pytest
from recording_samples import same, shared_data

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.command_line import run
from dvrk_gravity.recording import Recording, check


def convert(*arguments):
    return run("dvrk_gravity.cli.convert", [str(argument) for argument in arguments])


EXPECTED = {
    "mtm_dynamic_30s_200hz.csv": {
        ("stale_samples", None), ("read_jitter", None),
        *(("velocity_mismatch", joint) for joint in JOINT_NAMES[4:]),
        *(("position_quantisation", joint) for joint in JOINT_NAMES[4:]),
    },
    "mtmr28002_static_pos.csv": {("no_motion", "outer_yaw"), ("no_motion", "wrist_roll")},
}  # fmt: skip


@pytest.mark.parametrize("name", EXPECTED)
def test_findings_on_measured_data_are_few_and_true(name):
    found = {(w.kind, w.joint): w for w in check(Recording.load(shared_data(name)))}
    assert set(found) == EXPECTED[name]
    assert not any(w.unusable for w in found.values())
    if ("stale_samples", None) in found:
        numbers = found["stale_samples", None].numbers
        assert (numbers["samples"], numbers["longest"]) == (795, 6)
        numbers = found["velocity_mismatch", "wrist_yaw"].numbers
        assert numbers["lag_s"] == pytest.approx(7e-3, abs=2e-3)


@pytest.mark.parametrize("name", ["bags/mtm_dynamic_sqlite3", "bags/mtm_dynamic_mcap"])
def test_measured_bags_agree_with_the_measured_csv(name, tmp_path):
    bag = Recording.load(shared_data(name))
    csv = Recording.load(shared_data("mtm_dynamic_30s_200hz.csv"), coordinates="actuator")
    assert (len(bag), bag.invalid, bag.repeated) == (5999, 0, 0)
    assert np.array_equal(bag.time, csv.time)
    to_joint = np.eye(7)
    to_joint[2, 1], to_joint[3, 1], to_joint[3, 2] = -1.0, 0.6697, -0.6697
    # The CSV is rounded to nine digits.
    np.testing.assert_allclose(bag.position, csv.position @ to_joint.T, atol=1e-8)
    np.testing.assert_allclose(bag.velocity, csv.velocity @ to_joint.T, atol=1e-7)
    np.testing.assert_allclose(bag.effort @ to_joint, csv.effort, atol=1e-8)
    assert convert(shared_data(name), tmp_path / "a.csv") == 0
    assert convert(tmp_path / "a.csv", tmp_path / "bag", "--storage", "mcap") == 0
    same(bag, Recording.load(tmp_path / "bag"))
