"""Recording a simulated arm: exciting motions, and static poses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.planning import Multisine, used_range
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate.run import simulate
from dvrk_gravity.simulate.simulated_arm import Measurement, SimulatedArm

_CREEP = 0.1  # of the speed of approach
_TOGETHER = 1000  # steps whose set points are evaluated at a time


def record_motion(
    arm: SimulatedArm, motion: Multisine, duration: float = 30.0, rate: float = 200.0
) -> Recording:
    """Let the arm's servo follow a motion and record it from the end of the ramp on.

    Args:
        arm: The arm; it is put at the motion's beginning.
        motion: What to follow.
        duration: Of the recording, s.
        rate: Samples recorded, Hz.
    """
    arm.plant.reset(motion.at(0.0)[0])
    ahead = _ahead(motion, arm.plant.time, arm.dt)

    def follow(simulated: SimulatedArm, _: Measurement) -> None:
        simulated.follow(*next(ahead))

    simulate(arm, follow, motion.ramp, rate)
    return simulate(arm, follow, duration, rate)


def _ahead(motion: Multisine, start: float, dt: float) -> Iterator[tuple[Array, Array]]:
    """Yield position and velocity (n,) a step ahead of a motion, after each step."""
    time = start
    while True:
        times = np.cumsum([time, *[dt] * _TOGETHER])[1:]  # as the plant adds its steps up
        yield from zip(*motion.at(times + dt - start), strict=True)
        time = float(times[-1])


def record_poses(
    arm: SimulatedArm, seed: int, count: int = 150, approach: float = 0.06, samples: int = 8
) -> Recording:
    """Record static poses, each approached from one side, as a calibration does.

    Args:
        arm: The arm.
        seed: Seed of poses and directions.
        count: Number of poses.
        approach: Way that every joint goes to a pose in the direction of approach, rad (a tenth of
            it, m, where a joint slides).
        samples: Readings averaged at every pose.

    Returns:
        Static poses with direction; position and effort are means of the readings.
    """
    random = np.random.default_rng(seed)
    geometry = arm.plant.model.arm
    n, way = geometry.n, approach * geometry.scale
    lowest, highest = geometry.range
    used = 0.5 * (highest - lowest) * used_range(geometry) - 2.0 * way
    middle = 0.5 * (lowest + highest)
    time, settling = round(0.3 / arm.dt), round(0.15 / arm.dt)
    position = np.empty((count, n))
    effort, direction = np.empty_like(position), np.empty_like(position)
    for pose in range(count):
        # All joints one way: then the motors that move several joints go that way too.
        sign = np.full(n, -1.0 if random.random() < 0.5 else 1.0)
        goal = middle + used * random.uniform(-1.0, 1.0, n)
        speed = way * sign / 0.3
        arm.plant.reset(goal - way * sign)
        for step in range(time):
            arm.follow(goal - way * sign + speed * step * arm.dt, speed)
            arm.step()
        readings = []
        # Still creeping: dry friction is whole, as where a position loop has just arrived, and
        # viscous friction is all but gone.
        creep = speed * _CREEP
        for step in range(settling + samples):
            arm.follow(arm.target + creep * arm.dt if arm.target is not None else goal, creep)
            arm.step()
            if step >= settling:
                measured = arm.measure()
                readings.append((measured.position, measured.effort))
        position[pose], effort[pose] = np.mean(readings, axis=0)
        direction[pose] = sign
    return Recording(
        geometry.joint_names,
        None,
        position,
        effort=effort,
        direction=direction,
        source="simulated poses",
    )
