"""Motions of identified arms with nothing hidden: what models say of themselves is counted."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.jobs import run_all
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import NAMES, MujocoWorld

MOTIONS = 3  # a seed
T = TypeVar("T")


def clean_motions(
    name: str, seed: int, random: np.random.Generator
) -> Iterator[tuple[TorqueModel, Recording]]:
    """Yield a model that was identified from one motion, and recordings of others, drawn in turn.

    Args:
        name: One of MuJoCo's arms (testing/mujoco_world.py).
        seed: Of the arm and its calibration motion.
        random: Of the other motions.
    """
    world = MujocoWorld.draw(name, seed)
    calibration = draw_calibration(world.arm, seed)
    model = identify(world.record(world.truth(calibration), seed), world.arm).model
    for _ in range(MOTIONS):
        drawn, noise = (int(value) for value in random.integers(1 << 30, size=2))
        yield model, world.record(world.truth(draw_other(world.arm, drawn, calibration)), noise)


def of_each_arm(
    run: Callable[[str, int], T], doc: str | None, given: Sequence[str] | None,
    arms: str = ",".join(NAMES),
) -> Iterator[tuple[str, int, T]]:  # fmt: skip
    """Yield arm, seed, and what a function returns of them, for the seeds of a command line.

    Args:
        run: Of an arm's name and a seed.
        doc: Of the command line; its first line is shown.
        given: Its words.
        arms: By default.
    """
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 5), metavar=("FIRST", "END"))
    parser.add_argument("--arms", default=arms, help="one a seed in turn")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    args = parser.parse_args(given)
    drawn, seeds = args.arms.split(","), range(*args.seeds)
    names = [drawn[seed % len(drawn)] for seed in seeds]
    results = run_all(run, list(zip(names, seeds, strict=True)), args.jobs)
    yield from zip(names, seeds, results, strict=True)
