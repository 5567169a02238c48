"""How long a calibration moves, and what a certificate requires."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class CalibrationSettings:
    """How a calibration is made.

    Attributes:
        motion_duration: Duration of the motion that the first model is identified from, s. Chosen:
            as `excite` and `plan`.
        check_duration: Duration of the motion that is held out, s. Chosen: as long as a diagnosis
            needs to judge.
        further_duration: Duration of each further motion, s: as of those that separate causes.
        rounds: Greatest number of further motions. Chosen.
        search: Evaluations of the objective for each plan. A number, and not a time: interrupted or
            not, on any computer, the same seed plans the same. 10 take 1 s of one core for a first
            plan, and about ten times as long with a model. Chosen: six of six MTMs were certified
            with 80 (`python benchmark/calibrate.py --arms mtmr --first 2 --count 6 --time 8`).
        least_gain: ``least_gain`` of :func:`identify`. Less than its default, since what holds a
            joint with a tenth of its friction is small. Chosen: at an MTM's wrist platform and
            pitch .0003 left half to two thirds of the error of gravity torque that .004 does (seeds
            1 and 2 of `benchmark/calibrate.py`), and less of it no more error than that.
        poses: Number of poses at which the arm is released.
        release_duration: Duration of each release, s.
        min_distance: Least distance of a pose from any sample that was fitted, rad (``Arm.scale``),
            in the joint that is furthest from it. Chosen.
        max_drift: Greatest drift of a joint that holds its pose, rad (``Arm.scale``).
        friction: Part of its friction that a simulated arm has while it is released: what holds an
            arm against errors of the model is friction, of which another arm may have less.
        max_duration: Greatest time of motion in all, s, rehearsals apart.
        rehearsal: Whether motions are rehearsed.
    """

    motion_duration: float = 60.0
    check_duration: float = 30.0
    further_duration: float = 40.0
    rounds: int = 2
    search: int = 100
    least_gain: float = 3e-5
    poses: int = 20
    release_duration: float = 10.0
    min_distance: float = math.radians(5.0)
    max_drift: float = math.radians(0.5)
    friction: float = 0.1
    max_duration: float = 600.0
    rehearsal: bool = True
