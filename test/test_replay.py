"""`replay`: a bag through the real node; and what it says of bags that it cannot play."""

from __future__ import annotations

import json

import numpy as np
import pytest
from support import MODEL_FILE

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.cli.replay import _expected, replay
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import BagWriter, Recording, read_joint_states


def make_bag(path, count=40, storage="sqlite3"):
    rng = np.random.default_rng(1)
    recording = Recording(
        joints=JOINT_NAMES,
        time=np.arange(count) * 0.005,
        position=rng.uniform(-0.4, 0.4, (count, 7)),
        velocity=rng.uniform(-1.0, 1.0, (count, 7)),
        effort=np.zeros((count, 7)),
        direction=None,
        coordinates="joint",
        source="test",
    )
    recording.save(path, storage=storage, topic="/MTMR/measured_js")
    return recording


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_every_message_is_answered_in_order_as_the_model_says(tmp_path, storage):
    recording = make_bag(tmp_path / "bag", storage=storage)
    out = tmp_path / "answers"
    result = replay(tmp_path / "bag", MODEL_FILE, out)
    assert result.passed
    assert result.answered == result.messages == 40
    assert result.largest_difference < 1e-12
    answers = list(read_joint_states(out, "/MTMR/servo_jf"))
    sent = list(read_joint_states(out, "/MTMR/measured_js"))
    assert [a.stamp_ns for a in answers] == [s.stamp_ns for s in sent]
    model = TorqueModel.load(MODEL_FILE)
    np.testing.assert_allclose(
        [a.effort for a in answers],
        model.torque(recording.position, recording.velocity),
        atol=1e-12,
    )


def test_messages_that_the_node_is_to_drop_are_not_due(tmp_path):
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    joint_state, header, stamp_type = (
        store.types[f"{name}"]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header",
                     "builtin_interfaces/msg/Time")
    )  # fmt: skip

    def message(stamp, position):
        return joint_state(
            header(stamp_type(*divmod(stamp, 1_000_000_000)), ""),
            list(JOINT_NAMES),
            np.array(position, float),
            np.zeros(7),
            np.zeros(7),
        )

    bad = [
        message(0, [0.1] * 7),
        message(1_050_000_000, [np.nan] * 7),
        message(1_000_000_000, [0.1] * 7),
    ]
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(10):
            good = message(1_100_000_000 + k * 5_000_000, [0.01 * k] * 7)
            for item in (good, *(bad if k == 4 else ())):
                writer.write(
                    "/MTMR/measured_js", "sensor_msgs/msg/JointState", item, 10**9 + k * 5_000_000
                )
    result = replay(tmp_path / "bag", MODEL_FILE, None)
    assert result.messages == 13
    assert result.valid == result.answered == 10
    assert result.passed


def test_a_wrong_effort_fails_the_replay(tmp_path):
    make_bag(tmp_path / "bag", count=5)
    model = TorqueModel.load(MODEL_FILE)
    samples = _expected(tmp_path / "bag", None, model)
    assert len(samples) == 5
    # The node runs another model than the comparison: as a defect in it would look.
    other = tmp_path / "other.yaml"
    TorqueModel(model.arm, model.terms[:1], model.node).save(other)
    from dvrk_gravity.cli import replay as module

    real = module._play
    module._play = lambda messages, _, *rest: real(messages, other, *rest)
    try:
        result = replay(tmp_path / "bag", MODEL_FILE, None)
    finally:
        module._play = real
    assert result.answered == 5
    assert result.largest_difference > 1e-3
    assert not result.passed


@pytest.mark.parametrize("storage", ["sqlite3", pytest.param("mcap", marks=pytest.mark.slow)])
def test_the_recording_of_a_real_arm_is_answered_throughout(measured_data, storage):
    result = replay(measured_data / f"bags/mtm_dynamic_{storage}", MODEL_FILE, None)
    assert result.answered == result.valid == result.messages == 5999
    assert result.in_order
    assert result.largest_difference < 1e-9


def test_the_command_prints_and_writes_its_result(tmp_path, capsys):
    from dvrk_gravity.__main__ import main

    make_bag(tmp_path / "bag", count=5)
    report = tmp_path / "result.json"
    status = main(
        ["replay", str(tmp_path / "bag"), "--model", str(MODEL_FILE), "--json", str(report)]
    )
    assert status == 0
    assert "5 of 5 answered" in capsys.readouterr().out
    assert json.loads(report.read_text())["passed"] is True
