"""Run the arm without ROS, as fast as it goes, and record what its sensors tell."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dvrk_gravity.errors import ConfigError
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
