"""The steps of a calibration that plan motions and record them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.calibration.certificate import Moved
from dvrk_gravity.calibration.kept import KeptDriver, LimitCheck
from dvrk_gravity.calibration.logbook import Logbook
from dvrk_gravity.calibration.release import PART, holding
from dvrk_gravity.calibration.work import Outcome, Work, model_file, trusted_model
from dvrk_gravity.collecting import CollectSettings, Journal, MotionStoppedError, collect
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.diagnosis import load_unseparated
from dvrk_gravity.files import json_file, text_file
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import (
    Plan,
    SeparationSettings,
    SolverSettings,
    Straight,
    design_motion,
    design_separation,
    resting_positions,
    series_basis,
)

_DRAWN = 100  # poses at which the holding torque's uncertainty is looked at
_HELD = 0.99  # part of them at which friction is to hold the arm: at all poses of a release, mostly
# Way from a pose to the nearest next one, as a part of the longest: of 20 poses of a UR5, .36.
_WAY = 0.4
_OTHER = 1000  # seeds of other motions are so much further


def plan_first(work: Work, book: Logbook, step: str) -> Outcome:
    """Plan the motion that the first model is identified from."""
    of = work.settings
    design = design_motion(
        work.arm, work.limits, series_basis(of.motion), None, work.seed,
        SolverSettings(seconds=of.search), partial(work.progress, step),
    )  # fmt: skip
    said = f"{of.motion:g} s, condition number {design.condition:.0f}"
    return _planned(work, "motion", design.plan, said)


def plan_second(work: Work, book: Logbook, step: str) -> Outcome:
    """Plan the motion that is held out: one that teaches what the model does not know yet."""
    of, model = work.settings, trusted_model(work, book)
    design = design_motion(
        work.arm, work.limits, series_basis(of.check), model, work.seed + _OTHER,
        SolverSettings(seconds=0.5 * of.search), partial(work.progress, step),
    )  # fmt: skip
    return _planned(work, "second", design.plan, f"{of.check:.3g} s, to be held out")


def plan_further(k: int, work: Work, book: Logbook, step: str) -> Outcome:
    """Plan a motion that separates causes, or else shows what holds the arm, where it is needed."""
    of, model = work.settings, trusted_model(work, book)
    if model is None or (book.motions(f"further_{k - 1}") is None and k > 1):
        return Outcome()
    longest = Straight.within(work.limits.lower, work.limits.upper, work.limits, PART).duration
    after = of.further + of.poses * (of.seconds + _WAY * longest)
    if Moved.total(book.moved()).seconds + after > of.longest:
        return Outcome(f"no further motion: {of.longest / 60:g} min would be exceeded")
    seed, name = work.seed + k * _OTHER + _OTHER, f"further_{k}"
    findings = work.at(f"diagnosis_{k - 1}.json")
    if json_file.load(findings)["unseparated"]["pairs"]:
        usual = SeparationSettings()
        seconds = min(usual.solver.seconds, of.search)
        design = design_separation(
            load_unseparated(findings, work.at(model_file(0))), work.limits, of.further,
            seed=seed, settings=replace(usual, solver=replace(usual.solver, seconds=seconds)),
            report=partial(work.progress, step),
        )  # fmt: skip
        if design.separates:
            apart = next(each.words for each in design.expected if each.separates)
            return _planned(work, name, design.plan, f"{of.further:.3g} s, to separate {apart}")
    poses = resting_positions(work.limits, work.arm, model, np.random.default_rng(seed), _DRAWN)
    ratio = holding(model, _within(model, poses), of.friction)
    held = float(np.mean((ratio < 1.0).all(axis=1)))
    if held >= _HELD:
        return Outcome()
    worst = work.arm.joint_names[int(np.argmax(np.median(ratio, axis=0)))]
    informative = design_motion(
        work.arm, work.limits, series_basis(of.further), model, seed,
        SolverSettings(seconds=0.5 * of.search), partial(work.progress, step),
    )  # fmt: skip
    return _planned(
        work, name, informative.plan,
        f"{of.further:.3g} s, for what holds the arm: with {100 * of.friction:g} % of its friction "
        f"{worst} is not sure to stay",
    )  # fmt: skip


def _within(model: TorqueModel, poses: Array) -> Array:
    """Return poses clipped to the range that a model was identified on."""
    known = model.uncertainty
    if known is None:
        return poses
    return np.clip(poses, known.lower + model.joint_offset, known.upper + model.joint_offset)


def _planned(work: Work, name: str, plan: Plan, said: str) -> Outcome:
    picture = work.at(f"{name}.png")
    text_file.write_bytes(picture, work.pages.plan(plan))
    path = work.at(f"{name}.yaml")
    plan.save(path, f"Planned by dvrk_gravity calibrate, seed {work.seed}.")
    return Outcome(said, (path, picture))


def collect_motion(name: str, work: Work, book: Logbook, step: str) -> Outcome:
    """Rehearse and record a motion; a bag that is whole already was recorded just before the end.

    A calibration that is interrupted in a motion goes on where it was stopped.
    """
    if book.entry(f"plan {name}") is None or not work.at(f"{name}.yaml").exists():
        return Outcome()
    plan, bag, of = Plan.load(work.at(f"{name}.yaml")), work.at(name), work.settings
    rehearsed = plan.duration / CollectSettings().rehearsal if of.rehearsal else 0.0
    if bag.exists():
        Journal(bag, "", "").remove()  # what a process that was killed just then has left
        check = LimitCheck(work.limits, work.arm)
        check.look(plan.at, plan.duration)
        motion = Moved(plan.duration, rehearsed, check.samples, check.used, check.most)
        return Outcome(f"{plan.duration:g} s, recorded before", (bag,), motion)
    with work.rig.driver() as moves:
        driver = KeptDriver(moves, work.limits, work.arm)
        try:
            found = collect(
                plan, driver, bag, model=trusted_model(work, book), rehearse=of.rehearsal,
                resume=True, limits=work.limits_now, consent=work.consent, report=lambda line: None,
                progress=lambda phase, part: work.progress(f"{step}, {phase}", part),
            )  # fmt: skip
        except MotionStoppedError as error:
            raise MotionError(
                f"{step}: stopped in its {error.phase}, {error.moment:.1f} s into the motion: "
                f"{error.why}; the same command goes on from there"
            ) from error
    motion = driver.motion(rehearsed=min(rehearsed, driver.seconds))
    # Earlier processes may have made a part of it.
    motion = replace(motion, seconds=max(motion.seconds, plan.duration))
    return Outcome(f"{found.samples} samples in {name}", (bag,), motion)
