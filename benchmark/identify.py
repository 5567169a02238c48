"""Speed of an identification, and whether its 95 % intervals hold what they promise.

Without arguments: time, memory and shares for 600,000 samples. With ``--coverage 200``: simulated
recordings with a known truth.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from dvrk_gravity.arm import Arm
from dvrk_gravity.identification import dynamic_fit, identify
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.identifiability import describe
from dvrk_gravity.identification.moments import Moments, build_design
from dvrk_gravity.identification.motion import read_motions
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate.excitation import Multisine
from dvrk_gravity.simulate.world import World
from dvrk_gravity.terms import State


def synthetic(samples: int, rate: float) -> tuple[Arm, Recording]:
    """Return a recording of a drawn arm along a drawn motion, noise added, without simulation."""
    world = World.draw(1)
    time_, noise = np.arange(samples) / rate, np.random.default_rng(0)
    motion = Multisine.draw(world.arm, 1)
    parts = [along(motion, part) for part in np.array_split(time_, 1 + samples // 20_000)]
    q, qd, qdd = (np.concatenate(one) for one in zip(*parts, strict=True))
    torque = world.model().torque(q, qd, qdd)
    torque += noise.normal(size=torque.shape) * 0.05 * torque.std(axis=0)
    return world.arm, Recording(world.arm.joint_names, time_, q, qd, torque)


def along(motion: Multisine, time_: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (N, 7) positions, velocities and accelerations of a sum of sines."""
    rate = 2.0 * np.pi * motion.frequency
    angle = time_[:, None, None] * rate + motion.phase
    q = motion.middle + (motion.amplitude * np.sin(angle)).sum(axis=1)
    qd = (motion.amplitude * rate * np.cos(angle)).sum(axis=1)
    qdd = -(motion.amplitude * rate**2 * np.sin(angle)).sum(axis=1)
    return q, qd, qdd


def speed(samples: int, rate: float) -> None:
    """Print time and memory of a fit and the shares of regressor and Gram matrices."""
    arm, recording = synthetic(samples, rate)
    start = time.perf_counter()
    fit = identify([recording], arm)
    total = time.perf_counter() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    start = time.perf_counter()
    motions = read_motions([recording], arm, "joint")
    prepared = time.perf_counter() - start
    q = motions.parts[0].state.q
    columns = Columns(arm, q.min(axis=0), q.max(axis=0))
    start = time.perf_counter()
    for motion in motions.parts:
        history = columns.history(motion.state)
        for first in range(0, len(motion), 2000):
            rows = slice(first, first + 2000)
            state = State(*(getattr(motion.state, name)[rows] for name in ("q", "qd", "qdd")))
            columns.regressor(state, history[rows])
    bare = time.perf_counter() - start
    start = time.perf_counter()
    design = build_design(columns, motions.parts)
    built = time.perf_counter() - start
    start = time.perf_counter()
    Moments.of(design.x, design.y, np.ones_like(design.y))
    gram = time.perf_counter() - start
    print(f"{samples} samples at {rate:g} Hz, {len(columns.columns)} columns")
    print(f"  total               {total:6.1f} s, {1e6 * total / samples:.1f} us a sample")
    print(f"  reading, filtering  {prepared:6.1f} s   (also once to find the coordinates)")
    print(f"  bare regressor      {bare:6.1f} s   of the samples that the motion's band needs")
    print(f"  regressor filtered  {built:6.1f} s")
    print(f"  Gram matrices       {gram:6.1f} s   (once; and once for all held-out blocks)")
    print(f"  most memory         {memory:6.2f} GiB")
    print(f"  fitted: {max(error.nrmse for error in fit.training.values()):.3f} at worst")


def coverage(repetitions: int, world_seed: int, duration: float) -> None:
    """Print how often the 95 % intervals of identifiable parameters hold the truth."""
    world = World.draw(world_seed)
    model = world.model()
    inside: dict[str, list[bool]] = {}
    for repetition in range(repetitions):
        recording = world.record(world_seed, 1000 + repetition, duration)
        caught: list[tuple] = []

        def catching(columns, chosen, solution, spread, design, caught=caught):
            caught.append((columns, chosen, spread, design))
            return describe(columns, chosen, solution, spread, design)

        dynamic_fit.describe = catching
        fit = identify([recording], world.arm, "joint")
        columns, chosen, spread, design = caught[0]
        theta = true_coefficients(model, columns, chosen)
        zero = describe(columns, chosen, theta, spread, design)[0]
        for parameter, truth in zip(fit.parameters, zero, strict=True):
            if parameter.identifiable:
                low, high = parameter.ci95
                inside.setdefault(parameter.name, []).append(low <= truth.value <= high)
        share = np.mean([one for many in inside.values() for one in many])
        print(f"{repetition + 1:4d}: {100 * share:.1f} % hold the truth", flush=True)
    for name, hits in sorted(inside.items(), key=lambda item: np.mean(item[1])):
        print(f"{100 * np.mean(hits):5.0f} %  of {len(hits):3d}  {name}")


def true_coefficients(model: TorqueModel, columns: Columns, chosen: list[int]):
    """Return the solution whose chosen columns give the true model's torque exactly."""
    from dvrk_gravity.identification.regression import Solution

    random = np.random.default_rng(5)
    q = random.uniform(columns.valid.lower, columns.valid.upper, (1500, 7))
    qd, qdd = random.normal(size=(2, 1500, 7)) * np.array([1.0, 4.0])[:, None, None]
    qd += 0.1 * np.sign(qd)  # where dry friction is full
    history = np.zeros((len(q), 4, 2, 7))
    x = columns.regressor(State(q, qd, qdd), history)[:, :, chosen].reshape(-1, len(chosen))
    y = columns.arm.actuator_effort(model.torque(q, qd, qdd)).ravel()
    scale = columns.scale[chosen]
    ridge = np.vstack([x * scale, 1e-6 * np.eye(len(chosen))])
    theta = scale * np.linalg.lstsq(ridge, np.append(y, np.zeros(len(chosen))), rcond=None)[0]
    empty = np.zeros((len(chosen), len(chosen)))
    return Solution(theta, empty, empty, np.ones(len(chosen), dtype=bool))


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=600_000)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--coverage", type=int, metavar="REPETITIONS")
    parser.add_argument("--world", type=int, default=1, help="seed of arm and motion")
    parser.add_argument("--duration", type=float, default=30.0, help="s, of a recording")
    arguments = parser.parse_args()
    if arguments.coverage:
        coverage(arguments.coverage, arguments.world, arguments.duration)
    else:
        speed(arguments.samples, arguments.rate)


if __name__ == "__main__":
    main()
