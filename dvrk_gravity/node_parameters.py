"""Declarations of the nodes' own parameters; the terms declare theirs."""

from __future__ import annotations

from dvrk_gravity.arm import N_JOINTS
from dvrk_gravity.parameter import Parameter

_SEVEN = (N_JOINTS,)

NODE_PARAMETERS: dict[str, Parameter] = {
    entry.name: entry
    for entry in (
        Parameter("enabled", True, "", "command the arm; ~/enable starts and stops it too"),
        Parameter(
            "effort_limit", (), "N·m", "largest joint effort; not given, or above it: the arm's",
            lower=0.0, upper=10.0, lengths=_SEVEN,
        ),
        Parameter(
            "actuator_effort_limit", (), "N·m",
            "largest actuator effort; not given, or above it: the arm's",
            lower=0.0, upper=10.0, lengths=_SEVEN,
        ),
        Parameter(
            "slew_limit", (20.0, 20.0, 20.0, 5.0, 2.0, 2.0, 1.0), "N·m/s",
            "fastest change of a joint's effort; 0, or above it: the arm's effort_limit in 0.02 s",
            lower=0.0, upper=1e4, lengths=_SEVEN,
        ),
        Parameter(
            "ramp_time", 1.0, "s",
            "from the effort the arm holds itself with to the model's, after enabling; changes of "
            "more than a tenth of a joint's effort limit take 0.2 s at least",
            lower=0.0, upper=60.0,
        ),
        Parameter(
            "start_tolerance", 0.3, "",
            "refuse to start where measured and modelled effort differ by more than this part of a "
            "joint's effort limit",
            lower=0.0, upper=2.0,
        ),
        Parameter(
            "timeout", 0.1, "s", "without valid input for so long: hold, and stop commanding",
            lower=0.002, upper=1.0,
        ),
        Parameter(
            "max_stamp_age", 1.0, "s",
            "refuse input whose stamp is further than this from the node's clock; 0: not checked",
            lower=0.0, upper=10.0,
        ),
        Parameter(
            "position_margin", 3.14, "rad",
            "refuse input with a joint further than this outside the arm's position limits",
            lower=0.0, read_only=True,
        ),
        Parameter(
            "friction_compensation.ratio", (0.7,) * N_JOINTS, "",
            "part of friction that is compensated; all of it may run away",
            lower=0.0, upper=1.0, lengths=_SEVEN,
        ),
        Parameter(
            "friction_compensation.dead_band", (0.05,) * N_JOINTS, "rad/s",
            "no friction is compensated below this speed",
            lower=0.0, upper=10.0, lengths=_SEVEN,
        ),
        # A tenth of 1.4 times the fastest motions in a published exciting trajectory of an MTM;
        # `benchmark/passivity.py` holds with it, and with delays not with twice as much.
        Parameter(
            "friction_compensation.allowance", (0.4, 0.4, 0.4, 0.8, 0.8, 0.8, 2.5), "rad/s",
            "a motion that grows beyond this speed is asked whether friction compensation feeds it",
            lower=0.05, upper=2.5, lengths=_SEVEN,
        ),
        # 1.4 times the fastest motion of the first joints and of the roll axis in a published
        # exciting trajectory of an MTM (2.95, 2.76, 1.07 and 17.7 rad/s), rounded; a hand leads
        # the wrist's other joints at 10 to 15 rad/s.
        Parameter(
            "speed_limit", (4.0, 4.0, 4.0, 15.0, 15.0, 15.0, 25.0), "rad/s",
            "hold where a joint is faster for 0.1 s while the command pushes it along",
            lower=0.1, upper=25.0, lengths=_SEVEN,
        ),
        Parameter(
            "resume", "explicit", "",
            "after a fault: wait for ~/enable, or go on by itself when input is good again",
            choices=("explicit", "automatic"),
        ),
        Parameter(
            "disable_builtin", False, "",
            "switch the arm's own compensation off (use_gravity_compensation false) when it is on",
        ),
        Parameter(
            "allow_poor_model", False, "",
            "command even with a model of which identify says: do not compensate with this",
        ),
        Parameter(
            "output", "servo_jf", "",
            "servo_jf: sensor_msgs/JointState; array: std_msgs/Float64MultiArray for ros2_control",
            choices=("servo_jf", "array"), read_only=True,
        ),
        Parameter(
            "output_topic", "", "", "topic of the commands; not given: servo_jf or commands",
            read_only=True,
        ),
        Parameter(
            "watchdog_timeout",
            0.1,
            "s",
            "watchdog: hold when commands stop for so long",
            lower=0.002,
            upper=1.0,
            read_only=True,
        ),
        Parameter(
            "input_depth", 1.0, "", "depth of the measured_js queue: 1 always takes the newest",
            lower=1.0, upper=10000.0, read_only=True,
        ),
    )
}  # fmt: skip
