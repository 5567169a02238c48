"""Declarations of the nodes' own parameters; terms declare theirs.

Limits and defaults are an arm's. Those of the master arms are measured (``arms/mtm``); another
arm's follow from its effort limits and from what its joints do, slide or turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from dvrk_gravity.arms import LARGEST, Arm, mtm
from dvrk_gravity.parameters.parameter import Parameter

# Defaults of an unknown arm: those of the first joints of an MTM. Speeds are rad/s (Arm.scale).
# A joint's whole effort takes so long, s.
SLEW_TIME = 0.1
# Speed beyond which a growing motion suspends friction compensation. `benchmark/passivity.py`
# passes with it, and with delays not with twice as much.
ALLOWANCE = 0.4
ACCEPT_READING_ERRORS = "accept_reading_errors"
# 1.4 times the fastest motion of the first joints in a published exciting trajectory of an MTM
# (2.95 rad/s).
SPEED_LIMIT = 4.0
# Speed below which no friction is compensated. Chosen: where the velocity's sign is noise.
DEAD_BAND = 0.05
# Part of friction that is compensated. Chosen: less than the whole, of a model that overestimates
# friction by up to 1 / 0.7.
FRICTION_RATIO = 0.7


@lru_cache(maxsize=8)
def node_parameters(arm: Arm) -> Mapping[str, Parameter]:
    """Return the nodes' parameters for an arm, by name."""
    lengths = (arm.n,)
    units = tuple(dict.fromkeys(joint.unit for joint in arm.joints))
    efforts = tuple(dict.fromkeys(joint.effort_unit for joint in arm.joints))
    effort = " or ".join(efforts)
    speed, slew = (" or ".join(f"{unit}/s" for unit in of) for of in (units, efforts))
    speeds, slews = (tuple(f"{unit}/s" for unit in of) for of in (arm.units, arm.effort_units))
    most = max(10.0, float(arm.effort_limit.max()), float(arm.actuator_effort_limit.max()))
    if not all(joint.effort_stated for joint in arm.joints):
        most = LARGEST
    least = float(arm.scale.min())
    slide = "; for prismatic joints a tenth, in m" if least < 1.0 else ""
    if mtm.is_mtm(arm):
        default = mtm.defaults.NODE_DEFAULTS
    else:
        default = {
            "slew_limit": tuple((arm.effort_limit / SLEW_TIME).tolist()),
            "friction_compensation.allowance": tuple((ALLOWANCE * arm.scale).tolist()),
            "speed_limit": tuple((SPEED_LIMIT * arm.scale).tolist()),
        }
    dead_band = tuple((DEAD_BAND * arm.scale).tolist())
    entries = (
        Parameter("enabled", True, "", "command the arm; ~/enable starts and stops it too"),
        Parameter(
            "effort_limit", (), effort, "largest joint effort; default and upper bound: the arm's",
            lower=0.0, upper=most, lengths=lengths, units=arm.effort_units,
        ),
        Parameter(
            "actuator_effort_limit", (), effort,
            "largest actuator effort; default and upper bound: the arm's",
            lower=0.0, upper=most, lengths=lengths, units=arm.effort_units,
        ),
        Parameter(
            "slew_limit", default["slew_limit"], slew,
            "fastest change of a joint's effort; 0, or above it: the arm's effort_limit in 0.02 s",
            lower=0.0, upper=max(1e4, most / SLEW_TIME), lengths=lengths, units=slews,
        ),
        Parameter(
            "ramp_time", 1.0, "s",
            "blend from the holding effort to the model's, after enabling; changes of more than a "
            "tenth of a joint's effort limit take at least 0.2 s",
            lower=0.0, upper=60.0,
        ),
        Parameter(
            "start_tolerance", 0.3, "",
            "refuse to start where measured and modelled effort differ by more than this part of a "
            "joint's effort limit",
            lower=0.0, upper=2.0,
        ),
        Parameter(
            "timeout", 0.1, "s", "hold the arm and stop after this long without valid input",
            lower=0.002, upper=1.0,
        ),
        Parameter(
            "max_stamp_age", 1.0, "s",
            "refuse input whose stamp is further than this from the node's clock; 0: not checked",
            lower=0.0, upper=10.0,
        ),
        Parameter(
            "position_margin", 3.14, "rad",
            f"refuse input with a joint further than this outside the arm's position limits{slide}",
            lower=0.0, read_only=True,
        ),
        Parameter(
            "friction_compensation.ratio", (FRICTION_RATIO,) * arm.n, "",
            "part of friction to compensate; at 1 the arm may run away",
            lower=0.0, upper=1.0, lengths=lengths,
        ),
        Parameter(
            "friction_compensation.dead_band", dead_band, speed,
            "no friction is compensated below this speed",
            lower=0.0, upper=10.0, lengths=lengths, units=speeds,
        ),
        Parameter(
            "friction_compensation.allowance", default["friction_compensation.allowance"], speed,
            "above this speed, friction compensation that may feed a growing motion is suspended",
            lower=0.05 * least, upper=2.5, lengths=lengths, units=speeds,
        ),
        Parameter(
            "speed_limit", default["speed_limit"], speed,
            "hold the arm if a joint is faster for 0.1 s while the command pushes it along",
            lower=0.1 * least, upper=25.0, lengths=lengths, units=speeds,
        ),
        Parameter(
            "resume", "explicit", "",
            "after a fault of the input: wait for ~/enable, or resume when the input is valid",
            choices=("explicit", "automatic"),
        ),
        Parameter(
            "disable_builtin", False, "",
            "switch the arm's own compensation off (use_gravity_compensation false) when it is on",
        ),
        Parameter(
            "allow_poor_model", False, "",
            "accept a model that identify found unfit for compensation",
        ),
        Parameter(
            ACCEPT_READING_ERRORS, False, "",
            "command by readings that the model knows to be wrong (reading.*), as they are",
        ),
        Parameter(
            "output", "servo_jf", "",
            "servo_jf: sensor_msgs/JointState; array: std_msgs/Float64MultiArray for ros2_control",
            choices=("servo_jf", "array"), read_only=True,
        ),
        Parameter(
            "output_topic", "", "", "topic of the commands; default: servo_jf or commands",
            read_only=True,
        ),
        Parameter(
            "command_joints", "", "",
            "order in which the controller or console takes joints, JOINT,…; default: the model's "
            "(array), which its parameter `joints` confirms, or that of measured_js (servo_jf)",
            read_only=True,
        ),
        Parameter(
            "watchdog_timeout", 0.1, "s",
            "watchdog: hold the arm after this long without a command",
            lower=0.002, upper=1.0, read_only=True,
        ),
        Parameter(
            "await_watchdog", 4.0, "s",
            "after its start a compensator waits so long for a watchdog to appear, before it "
            "commands without one; 0: it does not wait",
            lower=0.0, upper=60.0, read_only=True,
        ),
        Parameter(
            "input_depth", 1.0, "", "depth of the measured_js queue; 1: always the newest",
            lower=1.0, upper=10000.0, read_only=True,
        ),
    )  # fmt: skip
    return {entry.name: entry for entry in entries}
