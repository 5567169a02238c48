"""`replay`: a bag through the real node, and every answer compared with the model's."""

from __future__ import annotations

import json

import numpy as np

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import JOINT_STATE, BagWriter, encode_joint_state, read_joint_states
from testing.world import World


def test_every_message_that_can_be_answered_is_answered_in_order_as_the_model_says(tmp_path):
    """With inertia, which is not compensated; not a number and stamps that go back are dropped."""
    model = World.draw(5).model()
    model.save(tmp_path / "model.yaml")
    random = np.random.default_rng(1)
    good: list[tuple[int, np.ndarray, np.ndarray]] = []
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/MTMR/measured_js", JOINT_STATE)
        for k in range(40):
            stamp = 1_100_000_000 + k * 5_000_000
            q, qd = random.uniform(-0.4, 0.4, 7), random.uniform(-1.0, 1.0, 7)
            good.append((stamp, q, qd))
            messages = [good[-1]]
            if k == 20:
                messages += [(stamp + 1, np.full(7, np.nan), qd), (1_000_000_000, q, qd)]
            for each, position, velocity in messages:
                data = encode_joint_state(each, JOINT_NAMES, position, velocity, np.zeros(7))
                writer.write("/MTMR/measured_js", JOINT_STATE, data, stamp)
    out, report = tmp_path / "answers", tmp_path / "result.json"
    words = [str(tmp_path / "bag"), "--model", str(tmp_path / "model.yaml"), "--out", str(out)]
    assert main(["replay", *words, "--json", str(report)]) == 0
    result = json.loads(report.read_text())
    assert result["passed"] is True
    assert (result["messages"], result["valid"], result["answered"]) == (42, 40, 40)
    answers = list(read_joint_states(out, "/MTMR/servo_jf"))
    assert [each.stamp_ns for each in answers] == [stamp for stamp, _, _ in good]
    rest = TorqueModel(model.arm, tuple(term for term in model.terms if term.COMPENSATED))
    expected = [rest.torque(q, qd) for _, q, qd in good]
    np.testing.assert_allclose([each.effort for each in answers], expected, atol=1e-12)
