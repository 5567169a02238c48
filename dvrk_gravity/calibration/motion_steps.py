"""The steps of a calibration that plan motions and record them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.calibration.checked_driver import CheckedDriver
from dvrk_gravity.calibration.logbook import Logbook
from dvrk_gravity.calibration.release import PART, release_poses
from dvrk_gravity.calibration.tally import MotionTally
from dvrk_gravity.calibration.work import Outcome, Work, fitted_bags, model_file, trusted_model
from dvrk_gravity.collecting import REHEARSAL, MotionStoppedError, collect, discard
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file, text_file
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import (
    Plan,
    SeparationSettings,
    SolverSettings,
    Straight,
    design_motion,
    design_separation,
    load_unresolved,
    series_basis,
)
from dvrk_gravity.recording import Recording

_EVERY = 10  # of the samples that were fitted, those that poses are compared with
_POSES = 2000  # seeds of poses are so much further than those of motions
_SURE = 0.95  # of the arms are to hold themselves at all poses of a release
_OTHER = 1000  # seeds of other motions are so much further
# An arm that follows a path is no further beside it than this, rad (Arm.scale), in so many moments
# of it. Chosen: above what stops a motion, 12 deg of a wrist's roll.
_BESIDE, _MOMENTS = float(np.radians(15.0)), 200


def plan_first(work: Work, book: Logbook, step: str) -> Outcome:
    """Plan the motion that the first model is identified from."""
    of = work.settings
    design = design_motion(
        work.arm, work.limits, series_basis(of.motion_duration), None, work.seed,
        _search(of.search), partial(work.progress, step),
    )  # fmt: skip
    summary = f"{of.motion_duration:g} s, condition number {design.condition:.0f}"
    if still := design.plan.still:
        summary += f"; hardly moves {', '.join(still)} within its limits"
    return _write_plan(work, "motion", design.plan, summary)


def plan_second(work: Work, book: Logbook, step: str) -> Outcome:
    """Plan the motion that is held out: one that teaches what the model does not know yet."""
    of, model = work.settings, trusted_model(work, book)
    design = design_motion(
        work.arm, work.limits, series_basis(of.check_duration), model, work.seed + _OTHER,
        _search(of.search // 2), partial(work.progress, step),
    )  # fmt: skip
    return _write_plan(work, "second", design.plan, f"{of.check_duration:.3g} s, to be held out")


def plan_further(k: int, work: Work, book: Logbook, step: str) -> Outcome:
    """Plan a motion that separates causes, or else shows what holds the arm, where it is needed."""
    of, model = work.settings, trusted_model(work, book)
    if model is None or (book.recorded(f"further_{k - 1}") is None and k > 1):
        return Outcome()
    findings = work.at(f"diagnosis_{k - 1}.json")
    found = json_file.load(findings)
    known = json_file.load(work.at(model_file(k - 1)).with_suffix(".json"), finite=False)["held"]
    holds = known["part"] >= _SURE ** (1.0 / of.poses)
    if holds and not found["next"]:
        return Outcome()
    if not _leaves_time(work, book, model):
        return Outcome(f"no further motion: {of.max_duration / 60:g} min would be exceeded")
    seed, name = work.seed + k * _OTHER + _OTHER, f"further_{k}"
    if found["next"]:
        usual = SeparationSettings()
        design = design_separation(
            load_unresolved(findings, work.at(model_file(0))), work.limits, of.further_duration,
            seed=seed, settings=replace(usual, solver=_search(of.search, usual.solver)),
            report=partial(work.progress, step),
        )  # fmt: skip
        if design.separates:
            apart = next(each.words for each in design.expected if each.separates)
            return _write_plan(
                work, name, design.plan, f"{of.further_duration:.3g} s, to separate {apart}"
            )
        if holds:
            return Outcome(f"no further motion is sure to separate {design.expected[0].words}")
    informative = design_motion(
        work.arm, work.limits, series_basis(of.further_duration), model, seed,
        _search(of.search // 2), partial(work.progress, step),
    )  # fmt: skip
    return _write_plan(
        work, name, informative.plan,
        f"{of.further_duration:.3g} s, for what holds the arm: with {100 * of.friction:g} % of its "
        f"friction {known['least']} is not sure to stay at {100 * (1 - known['part']):.0f} % of "
        "poses",
    )  # fmt: skip


def poses_to_release_at(
    work: Work, book: Logbook, model: TorqueModel, where: Array
) -> tuple[Array, float]:
    """Return the poses at which an arm at (n,) is released; see :func:`release_poses`."""
    bags = fitted_bags(work, book, work.settings.rounds)
    fitted = np.vstack([Recording.load(bag).position[::_EVERY] for bag in bags])
    return release_poses(
        work.arm, work.limits, model, fitted, work.settings, work.seed + _POSES, where
    )


def _leaves_time(work: Work, book: Logbook, model: TorqueModel) -> bool:
    """Return whether a further motion, and the releases that it leads to, end in time.

    Those will take about as long as those that the present model leads to.
    """
    of, limits = work.settings, work.limits
    where = 0.5 * (limits.lower + limits.upper)
    poses, _ = poses_to_release_at(work, book, model, where)
    seconds = sum(
        Straight.within(start, goal, limits, PART).duration + of.release_duration
        for start, goal in pairwise([where, *poses])
    )
    return book.total.seconds + of.further_duration + seconds <= of.max_duration


def _search(evaluations: int, solver: SolverSettings | None = None) -> SolverSettings:
    """Return a search that ends by its own count: interrupted or not, it finds the same motion."""
    return replace(solver or SolverSettings(), seconds=np.inf, evaluations=max(evaluations, 1))


def _write_plan(work: Work, name: str, plan: Plan, summary: str) -> Outcome:
    picture = work.at(f"{name}.png")
    text_file.write_bytes(picture, work.pages.plan(plan))
    path = work.at(f"{name}.yaml")
    plan.save(path, f"Planned by dvrk_gravity calibrate, seed {work.seed}.")
    return Outcome(summary, (path, picture))


def collect_motion(name: str, work: Work, book: Logbook, step: str) -> Outcome:
    """Rehearse and record a motion; a bag that is whole already was recorded just before the end.

    A calibration that is interrupted in a motion goes on where it was stopped, where the rig can.
    """
    if book.entry(f"plan {name}") is None or not work.at(f"{name}.yaml").exists():
        return Outcome()
    # It was planned within limits that were accepted, and its file has not changed since.
    plan = Plan.load(work.at(f"{name}.yaml"), beyond_defaults=True)
    bag, of = work.at(name), work.settings
    if bag.exists():
        _require_of(plan, bag)
        discard(bag)  # what a process that was killed just then has left
        # How the arm was moved was noted then.
        return Outcome(f"{plan.duration:g} s, recorded before", (bag,), MotionTally(0.0, 0.0))
    if not work.rig.resumes:
        discard(bag)
    with work.rig.driver() as moves:
        driver = CheckedDriver(moves, work.limits, work.arm, book.note_motion)

        def progress(phase: str, part: float) -> None:
            driver.rehearsing = phase.startswith(REHEARSAL)
            work.progress(f"{step}, {phase}", part)

        try:
            found = collect(
                plan, driver, bag, model=trusted_model(work, book), rehearse=of.rehearsal,
                resume=True, limits=work.limits_now, look=driver.look, consent=work.consent,
                report=lambda line: None, progress=progress,
            )  # fmt: skip
        except MotionStoppedError as error:
            raise MotionError(
                f"{step}: stopped in its {error.phase}, {error.moment:.1f} s into the motion: "
                f"{error.why}; the same command goes on from there"
            ) from error
    return Outcome(f"{found.samples} samples in {name}", (bag,), driver.motion())


def _require_of(plan: Plan, bag: Path) -> None:
    """Check that a recording went all along a plan: another one would be taken for this one's.

    Raises:
        ConfigError: It did not.
        RecordingError: It cannot be read.
    """
    from scipy.spatial import KDTree

    recording = Recording.load(bag)
    recorded = recording.position[:, [recording.joint(name) for name in plan.arm.joint_names]]
    recorded = (recorded - plan.limits.turns(plan.arm, recorded[0])) / plan.arm.scale
    path = plan.at(np.linspace(0.0, plan.duration, _MOMENTS))[0] / plan.arm.scale
    if KDTree(recorded).query(path, p=np.inf)[0].max() > _BESIDE:
        raise ConfigError(
            "", "a recording of another motion", f"one of {bag.name}.yaml; remove it, to record "
            "that motion", bag,
        )  # fmt: skip
