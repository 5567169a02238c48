"""The simulator node of an arm that is no master arm."""

from __future__ import annotations

import numpy as np
from made_up_arm import write
from simulator_user import User, simulator
from std_msgs.msg import Float64MultiArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.simulate import PlantFile


def test_another_arm_obeys_an_array_and_reads_its_efforts_in_amperes(domain, tmp_path):
    gains = np.array([2.0, 4.0, 5.0, 10.0])
    path = write(tmp_path, {"drive_gains": gains.tolist()})
    start = [0.1, 0.2, 0.1, 0.3]
    given = (f"arm:={path}", "output:=array", f"initial_position:={start}")
    with (
        simulator(*given, "builtin_gravity_compensation:=false"),
        User(commands=Float64MultiArray) as user,
    ):
        user.connect()
        made_up = Arm.load(str(path))
        first = user.seen["measured_js"][-1]
        assert tuple(first.name) == made_up.joint_names
        np.testing.assert_allclose(first.position, start, atol=1e-3)
        plant = PlantFile.of(made_up).plant()
        plant.reset(np.array(first.position))
        np.testing.assert_allclose(first.effort, plant.smooth_torque() / gains, atol=1e-3)
        # No effort: the insertion slides by its weight.
        user.send["commands"](Float64MultiArray(data=[0.0] * 4))
        user.wait(lambda: abs(user.position[2] - start[2]) > 0.01, "sliding")
