"""The URDFs of many robots, as `example-robot-data` brings them."""

from __future__ import annotations

from robots import ROBOTS

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError

NOT_ARMS = {
    "alex_psyonic_hands": "mimic: got 'index_q1'",
    "allegro_left_hand": "dots",
    "allegro_right_hand": "dots",
    "quadrotor_base": "none of 0 that moves",
    "iris_simple": "none of 5 that moves",
    "ur3": "link: got 'none'",  # an empty one
}


def test_the_files_of_many_robots_are_read():
    refused = {}
    files = sorted(ROBOTS.rglob("*.urdf"))
    for path in files:
        try:
            assert (Arm.load(path).effort_limit > 0.0).all()
        except ConfigError as error:
            refused[path.stem] = str(error)
    assert len(files) > 50
    assert refused.keys() == NOT_ARMS.keys()
    assert all(NOT_ARMS[name] in said for name, said in refused.items())
