"""Declarations of the nodes' own parameters; the terms declare theirs.

Limits and defaults are an arm's. Those of the master arms are measured (``arms/mtm``); another
arm's follow from its effort limits and from what its joints do, slide or turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from dvrk_gravity.arms import LARGEST, Arm, mtm
from dvrk_gravity.parameters.parameter import Parameter


@dataclass(frozen=True)
class DefaultLimits:
    """Defaults of an arm of which nothing more is known: what the first joints of an MTM have.

    Speeds are rad/s, and as much at a lever of 0.1 m where a joint slides (``Arm.scale``).

    Attributes:
        slew_time: A joint's whole effort takes so long, s.
        allowance: Speed beyond which a growing motion is asked about. `benchmark/passivity.py`
            holds with it, and with delays not with twice as much.
        speed_limit: 1.4 times the fastest motion of the first joints in a published exciting
            trajectory of an MTM (2.95 rad/s).
        dead_band: Speed below which no friction is compensated. Chosen: where the velocity's sign
            is noise.
        ratio: Part of friction that is compensated. Chosen: a model that takes friction for up to
            1 / 0.7 of what it is then pushes less than all of it.
    """

    slew_time: float = 0.1
    allowance: float = 0.4
    speed_limit: float = 4.0
    dead_band: float = 0.05
    ratio: float = 0.7


DEFAULTS = DefaultLimits()


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
    slide = "; of one that slides a tenth, in m" if least < 1.0 else ""
    if mtm.is_mtm(arm):
        default = mtm.defaults.NODE_DEFAULTS
    else:
        default = {
            "slew_limit": tuple((arm.effort_limit / DEFAULTS.slew_time).tolist()),
            "friction_compensation.allowance": tuple((DEFAULTS.allowance * arm.scale).tolist()),
            "speed_limit": tuple((DEFAULTS.speed_limit * arm.scale).tolist()),
        }
    dead_band = tuple((DEFAULTS.dead_band * arm.scale).tolist())
    entries = (
        Parameter("enabled", True, "", "command the arm; ~/enable starts and stops it too"),
        Parameter(
            "effort_limit", (), effort, "largest joint effort; not given, or above it: the arm's",
            lower=0.0, upper=most, lengths=lengths, units=arm.effort_units,
        ),
        Parameter(
            "actuator_effort_limit", (), effort,
            "largest actuator effort; not given, or above it: the arm's",
            lower=0.0, upper=most, lengths=lengths, units=arm.effort_units,
        ),
        Parameter(
            "slew_limit", default["slew_limit"], slew,
            "fastest change of a joint's effort; 0, or above it: the arm's effort_limit in 0.02 s",
            lower=0.0, upper=max(1e4, most / DEFAULTS.slew_time), lengths=lengths, units=slews,
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
            f"refuse input with a joint further than this outside the arm's position limits{slide}",
            lower=0.0, read_only=True,
        ),
        Parameter(
            "friction_compensation.ratio", (DEFAULTS.ratio,) * arm.n, "",
            "part of friction that is compensated; all of it may run away",
            lower=0.0, upper=1.0, lengths=lengths,
        ),
        Parameter(
            "friction_compensation.dead_band", dead_band, speed,
            "no friction is compensated below this speed",
            lower=0.0, upper=10.0, lengths=lengths, units=speeds,
        ),
        Parameter(
            "friction_compensation.allowance", default["friction_compensation.allowance"], speed,
            "a motion that grows beyond this speed is asked whether friction compensation feeds it",
            lower=0.05 * least, upper=2.5, lengths=lengths, units=speeds,
        ),
        Parameter(
            "speed_limit", default["speed_limit"], speed,
            "hold where a joint is faster for 0.1 s while the command pushes it along",
            lower=0.1 * least, upper=25.0, lengths=lengths, units=speeds,
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
    )  # fmt: skip
    return {entry.name: entry for entry in entries}
