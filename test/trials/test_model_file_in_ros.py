"""A model's file as every ROS node reads it."""

from __future__ import annotations

import json
import subprocess
import sys

from support import MODEL_FILE

from dvrk_gravity import TorqueModel

# Reads a parameter file as every ROS node does, and tells what has arrived, floats bit by bit.
ROS_READER = """
import json, sys, rclpy
from rclpy.node import Node
rclpy.init(args=["--ros-args", "--params-file", sys.argv[1]])
node = Node("reader", automatically_declare_parameters_from_overrides=True)
def plain(value):
    if isinstance(value, (bool, str)):
        return value
    return value.hex() if isinstance(value, float) else [x.hex() for x in value]
print(json.dumps({name: plain(p.value) for name, p in node.get_parameters_by_prefix("").items()}))
"""


def test_ros_reads_the_same_numbers_from_a_model_s_file(tmp_path):
    values = TorqueModel.load(MODEL_FILE).parameters()
    values["beta"] = (1e-05, 1.0, -2.0, 1e-300, -3e-308, -0.0, 99.0, 0.1, 1e-16, 1.5e-7)
    values |= {"elastic_cable.elbow_pitch": (1e16, -1e22, 3.0), "timeout": 1.0}
    values |= {"coulomb_friction.joint_positive": (0.0,) * 7}
    values |= {"coulomb_friction.joint_negative": (1.0,) * 7, "resume": "automatic"}
    values["console.document"] = json.dumps({"long": "word and word " * 2000, "é": "'\"\\"})
    values["friction_compensation.dead_band"] = (5e-324,) * 7  # ROS takes it for a text: written 0
    file = tmp_path / "model.yaml"
    TorqueModel.from_parameters(values).save(file)
    model = TorqueModel.load(file)
    assert model.node["friction_compensation.dead_band"] == (0.0,) * 7
    reader = subprocess.run(
        [sys.executable, "-c", ROS_READER, str(file)], capture_output=True, text=True, timeout=120
    )
    assert reader.returncode == 0, reader.stderr
    read = json.loads(reader.stdout)
    for name, value in model.parameters().items():
        if isinstance(value, bool | str):
            assert read[name] == value
        elif isinstance(value, float):
            assert read[name] == value.hex()
        else:
            assert read[name] == [x.hex() for x in value], name
