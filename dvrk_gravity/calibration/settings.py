"""How long a calibration moves, and what a certificate requires."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class CalibrationSettings:
    """How a calibration is made.

    Attributes:
        motion: Duration of the motion that the first model is identified from, s. Chosen: as
            `excite` and `plan`.
        check: Duration of the motion that is held out, s. Chosen: as long as a diagnosis needs to
            judge.
        further: Duration of each further motion, s: as of those that separate causes.
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
        seconds: Duration of each release, s.
        apart: Least distance of a pose from any sample that was fitted, rad (``Arm.scale``), in the
            joint that is furthest from it. Chosen.
        allowed: Greatest drift of a joint that holds its pose, rad (``Arm.scale``).
        friction: Part of its friction that a simulated arm has while it is released: what holds an
            arm against errors of the model is friction, of which another arm may have less.
        longest: Greatest time of motion in all, s, rehearsals apart.
        rehearsal: Whether motions are rehearsed.
    """

    motion: float = 60.0
    check: float = 30.0
    further: float = 40.0
    rounds: int = 2
    search: int = 100
    least_gain: float = 3e-5
    poses: int = 20
    seconds: float = 10.0
    apart: float = math.radians(5.0)
    allowed: float = math.radians(0.5)
    friction: float = 0.1
    longest: float = 600.0
    rehearsal: bool = True
