"""How often the interval of a load's mass on a PSM holds it, and how wide it is.

    python benchmark/payloads.py --seeds 0 8

Every seed draws a PSM of MuJoCo's (testing/mujoco_world.py), identifies it from one motion, and
repeats that motion at full and at half speed with loads of 50 to 300 g: on the rail, the
instrument's carriage, and the parallelogram's parts. Each is weighed by the model and against a
recording without it, its place unknown and stated.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import (
    CrossValidation,
    FilteredData,
    LoadPosterior,
    MeasuredMotion,
    build,
    refined,
    relinearised,
)
from dvrk_gravity.effects import Estimate, Payload, State
from dvrk_gravity.identification import identify
from testing.clean_motions import of_each_arm
from testing.lab_motion import draw_calibration
from testing.lab_physics import Truth
from testing.mujoco_world import MujocoWorld

LOADS = 2  # at each speed, a seed
MASSES = (0.05, 0.3)  # kg
SPEEDS = {"full": 1.0, "half": 0.5}
# Corners of where a load is, m, in the frame of the link.
PLACES = {
    "link2": ((0.0, 0.25, -0.05), (0.06, 0.55, 0.05)),
    "link3": ((-0.04, -0.04, -0.02), (0.04, 0.04, 0.1)),
    "lower_bar": ((-0.03, 0.05, -0.03), (0.03, 0.5, 0.03)),
    "upper_bar": ((-0.03, 0.05, -0.03), (0.03, 0.5, 0.03)),
}
_LIKELY = ("link2", "link3")  # where a load is looked for: others move as these do, or nearly


@dataclass(frozen=True)
class Weighed:
    """One load, weighed in one way.

    Attributes:
        way: Beside what, at which speed, and whether the place is stated.
        truth: kg.
        mass: As estimated.
    """

    way: tuple[str, str, str]
    truth: float
    mass: Estimate

    @property
    def holds(self) -> bool:
        """Whether the interval holds the mass."""
        return bool(self.mass.low <= self.truth <= self.mass.high)


def weighed(name: str, seed: int) -> list[Weighed]:
    """Return what loads on an arm weigh."""
    random = np.random.default_rng([seed, 3])
    world = MujocoWorld.draw(name, seed)
    calibration = draw_calibration(world.arm, seed)
    model = identify(world.record(world.truth(calibration), seed), world.arm, "joint").model
    result = []
    for speed, factor in SPEEDS.items():
        bare = world.truth(replace(calibration, frequency=factor * calibration.frequency))
        for _ in range(LOADS):
            link = str(random.choice(list(PLACES)))
            mass, place = float(random.uniform(*MASSES)), random.uniform(*PLACES[link])
            noises = random.integers(1 << 30, size=2)
            reference = world.record(bare, int(noises[0]))
            loaded = world.record(_with(bare, link, mass, place), int(noises[1]))
            at = f"{link}:" + ",".join(f"{along:.6f}" for along in place)
            for where in (None, at):
                beside = {
                    "model": build(loaded, model, coordinates="joint", payload_at=where),
                    "reference": build(
                        loaded, coordinates="joint", reference=reference, arm=world.arm,
                        payload_at=where,
                    ),
                }  # fmt: skip
                known = "unknown" if where is None else "stated"
                for what, (motion, *_) in beside.items():
                    result.append(Weighed((what, speed, known), mass, _mass(motion)))
    return result


def _with(truth: Truth, link: str, mass: float, place: Array) -> Truth:
    load = Payload(truth.arm, link, mass, mass * place, truth.arm.gravity)
    return replace(truth, effort=truth.effort + load.torque(State(*truth.motion)))


def _mass(motion: MeasuredMotion) -> Estimate:
    """Return the mass of a payload that is all that is off."""
    validation = CrossValidation.of(FilteredData.of(motion))
    stated = motion.payload_at is not None
    found = [each for each in Payload.hypotheses(motion) if stated or each.form in _LIKELY]
    loads = [refined(validation, each, []) for each in validation.data.candidates(found)]
    load = min(loads, key=lambda each: validation.misfit([each]))
    validation, (load,) = relinearised(validation.weighted([load]), [load])
    theta, spread = validation.parameters([load]), np.zeros((load.size, load.size))
    posterior = LoadPosterior.of(validation, [load], load, theta, spread)
    return posterior.estimates(load.hypothesis)["mass"]


def _rows(found: Sequence[Weighed]) -> Iterator[str]:
    yield "beside     speed  place    loads  hold, %  width, %  off, %"
    for way in sorted({each.way for each in found}):
        same = [each for each in found if each.way == way]
        holds = 100.0 * np.mean([each.holds for each in same])
        width = 100.0 * np.median([(each.mass.high - each.mass.low) / each.truth for each in same])
        off = 100.0 * np.median([abs(each.mass.value / each.truth - 1.0) for each in same])
        words = "{:10s} {:6s} {:8s}".format(*way)
        yield f"{words} {len(same):5d} {holds:8.0f} {width:9.0f} {off:7.1f}"


def main(given: Sequence[str] | None = None) -> int:
    """Print the table: share of the intervals that hold, median width and error over the mass."""
    found: list[Weighed] = []
    for name, seed, of_arm in of_each_arm(weighed, __doc__, given, "psm"):
        found += of_arm
        hold = sum(each.holds for each in of_arm)
        print(f"{name} {seed}: {hold} of {len(of_arm)} hold", file=sys.stderr, flush=True)
    print("\n".join(_rows(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
