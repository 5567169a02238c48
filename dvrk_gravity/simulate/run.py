"""Simulated recordings, faster than real time: of any commands, exciting motions, static poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.planning import Multisine, used_range
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate.simulated_arm import Measurement, SimulatedArm

Controller = Callable[[SimulatedArm, Measurement], None]


def simulate(
    arm: SimulatedArm,
    controller: Controller | None,
    duration: float,
    rate: float = 1000.0,
) -> Recording:
    """Run the arm and record it.

    After every step the controller gets the arm and what the sensors read, and commands
    whatever it likes: ``lambda arm, m: arm.servo_jf(model.torque(m.position))``.

    Args:
        arm: The arm; goes on from where it is.
        controller: Called at every step; ``None`` leaves the arm alone.
        duration: s.
        rate: Samples recorded, Hz: a whole part of the step rate ``1 / arm.dt``.

    Returns:
        Measured time from 0, position, velocity and effort in joint space.

    Raises:
        ConfigError: A rate that the steps do not divide into, or no step at all.
    """
    every = round(1.0 / (rate * arm.dt)) if rate > 0 else 0
    if every < 1 or abs(every * rate * arm.dt - 1.0) > 1e-6:
        raise ConfigError("rate", rate, f"{1 / arm.dt:g} Hz divided by a whole number")
    steps = round(duration / arm.dt)
    if steps < 1:
        raise ConfigError("duration", duration, f"at least {arm.dt:g} s")
    shape = (-(-steps // every), arm.plant.q.size)
    position, velocity, effort = np.empty(shape), np.empty(shape), np.empty(shape)
    for step in range(steps):
        arm.step()
        measured = arm.measure()
        if controller is not None:
            controller(arm, measured)
        if step % every == 0:
            row = step // every
            position[row] = measured.position
            velocity[row] = measured.velocity
            effort[row] = measured.effort
    time = np.arange(shape[0], dtype=np.float64) * (every * arm.dt)
    return Recording(
        arm.plant.model.arm.joint_names, time, position, velocity, effort, source="simulation"
    )


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
    ahead = _set_points(motion, arm.plant.time, arm.dt)

    def follow(simulated: SimulatedArm, _: Measurement) -> None:
        simulated.follow(*next(ahead))

    simulate(arm, follow, motion.ramp, rate)
    return simulate(arm, follow, duration, rate)


def _set_points(motion: Multisine, start: float, dt: float) -> Iterator[tuple[Array, Array]]:
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
