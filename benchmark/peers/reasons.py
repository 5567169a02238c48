"""Why a peer is better somewhere on ``docs/peers.md``, with the command that shows it.

Written by hand, beside figures that a run prints: look at them again when a run prints others.
"""

_GAINS = "`benchmark/term_gains.py`"
_SEEDS = "`benchmark/peers/seeds.py`"
_JITTER = "`benchmark/peers/jitter.py`"
_CONSTANTS = "`benchmark/peers/constants.py --four-minutes`"

REASONS = {
    ("UR5", "holding torque"): (
        "Not in general: shoulder_pan, which is upright and holds only a cable, and the wrist make "
        "this mean. On six other UR5s least squares is worse at the shoulder lift by 0.012 ± "
        "0.004, at the elbow by 0.014 ± 0.014, and better at no joint "
        f"({_SEEDS}). All methods are near 0.45 here."
    ),
    ("UR5_four_minutes", "holding torque"): (
        "The simulated friction differs by direction: in motion a constant torque, which no method "
        "distinguishes from one that acts at rest, too. At shoulder_pan it is 0.267 N·m, ours "
        "0.275, least squares' 0.214; at the elbow -0.625, ours -0.632, theirs -0.590. Besides "
        f"it, ours is off by 0.025 N·m RMS at most, theirs by 0.082 ({_CONSTANTS})."
    ),
    ("MTM", "wrist_platform"): (
        "Not in general: on six other MTMs and motions they are worse there by 0.145 ± 0.053 "
        f"(figaroh) to 0.205 ± 0.067 (mujoco.sysid; {_SEEDS})."
    ),
    ("UR10e_real", "shoulder_pan_joint"): (
        "It was 0.095 before friction that builds up over some mrad was identified, which brought "
        "the lift from 0.071 to 0.043 and the elbow from 0.055 to 0.036. Over six windows of the "
        "recording, the terms of least squares changed our error there by +0.001 ± 0.005 "
        f"({_GAINS}, before that)."
    ),
    ("MTM_real", "shoulder_pitch"): (
        "Even times hide the recording's jitter from `identify` (see outer_yaw below). Over six "
        "windows of the recording as it is, the terms of least squares are worse there by 0.023 ± "
        f"0.018 ({_GAINS})."
    ),
    ("", "an identification, mean processor time"): (
        "Least squares solves once for given terms. We choose the terms on held-out blocks, and "
        "give a verdict and intervals."
    ),
    ("", "an identification, mean peak memory"): (
        "It has no columns but those of its terms, at one sample in four."
    ),
    ("", "a diagnosis, for a peer a refit, mean processor time"): (
        "A refit compares no causes: see what it names."
    ),
}

# What was better in earlier comparisons, or would be without what the package does.
ELSEWHERE = (
    "Without physical consistency, our error at MTM_real's outer_yaw would be 0.125, not 0.159. "
    "Even times keep the recording's jitter of 2.7 ms. Noise in accelerations makes inertia too "
    "small: 0.083 kg·m² about that joint, which no links of this weight have. Bodies have 0.123; "
    "the recording as it is gives 0.180. The motion that is judged has the same noise, which "
    "favours too small an inertia. With the recording as it is, bodies cost nothing: 0.067 against "
    f"0.066 ({_JITTER}), and over windows at most 0.001 at any joint ({_GAINS}).",
    "Least squares was better in one window at the real UR10e's shoulder_lift, mujoco.sysid at the "
    "real MTM's wrist_roll. Over six windows, the terms of least squares change our error by "
    f"-0.007 ± 0.008 and +0.018 ± 0.006 ({_GAINS}): no difference, and worse.",
    "A refit of the console's own form was better at joint 6 for static poses of a later day. On "
    "poses of the same day it is not: 8.6 against our 4.0 mN·m (`benchmark/static_cv.py`).",
)


def reason(case: str, figure: str) -> str:
    """Return why a peer is better in a figure of a case, as far as it is known."""
    return REASONS.get((case, figure), "Why is not known.")
