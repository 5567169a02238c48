"""The steps of a calibration: each a function from files that are there to files that it leaves."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity import __version__
from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.calibration.certificate import Certificate, Moved, certify
from dvrk_gravity.calibration.kept import KeptDriver, LimitCheck
from dvrk_gravity.calibration.logbook import Logbook
from dvrk_gravity.calibration.release import PART, holding, predicted_drift, release_poses
from dvrk_gravity.calibration.rig import Rig
from dvrk_gravity.calibration.settings import CalibrationSettings
from dvrk_gravity.collecting import CollectSettings, Journal, MotionStoppedError, collect
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.diagnosis import Diagnosis, Files, diagnose, load_unseparated
from dvrk_gravity.files import json_file, text_file
from dvrk_gravity.files.lock import alone_in
from dvrk_gravity.identification import POOR, Evaluation, Fit, by_errors, evaluate, identify
from dvrk_gravity.model import TorqueModel, uncertainty_file
from dvrk_gravity.planning import (
    Plan,
    PlanLimits,
    SeparationSettings,
    SolverSettings,
    Straight,
    design_motion,
    design_separation,
    resting_positions,
    series_basis,
)
from dvrk_gravity.recording import Recording

MODEL, CHECK, RELEASE = "model.yaml", "check.json", "release.json"
CERTIFICATE = "certificate.json"
_SOFTWARE = ("numpy", "scipy", "pin")
_EVERY = 10  # of the samples that were fitted, those that poses are compared with
_DRAWN = 100  # poses at which the holding torque's uncertainty is looked at
_HELD = 0.95  # part of them at which friction is to hold the arm
_DRAWS = 3  # arms for which drift is predicted. Chosen: each takes as long as a release
_OTHER, _POSES = 1000, 2000  # seeds of other motions, and of poses, are so much further


@dataclass(frozen=True)
class Pages:
    """What is rendered: pictures of plans, and pages of what was found."""

    plan: Callable[[Plan], bytes]
    identification: Callable[[Fit, str], str]
    diagnosis: Callable[[Diagnosis, Sequence[str]], str]
    certificate: Callable[[Certificate, Evaluation], str]


@dataclass(frozen=True, eq=False)
class Work:
    """One calibration: what is asked for, and what does it.

    Attributes:
        folder: Where files are left; it exists.
        asked: By option; see :meth:`Logbook.open`.
        arm: The arm.
        limits: What every motion keeps.
        rig: Moves and compensates it.
        pages: What is rendered.
        namespace: Of its topics.
        seed: Of plans and poses.
        settings: How it is made.
        limits_now: The same limits, asked before every phase of a motion; raises MotionError if
            they have changed.
        consent: Asked before the arm moves.
        report: Receives lines.
        progress: Receives a step, and its part that is done.
    """

    folder: Path
    asked: dict[str, str]
    arm: Arm
    limits: PlanLimits
    rig: Rig
    pages: Pages
    namespace: str
    seed: int
    settings: CalibrationSettings
    limits_now: Callable[[], PlanLimits] | None = None
    consent: Callable[[str], bool] = lambda question: True
    report: Callable[[str], None] = print
    progress: Callable[[str, float], None] = lambda step, part: None

    def at(self, name: str) -> Path:
        """Return the path of a file."""
        return self.folder / name

    def write(self, name: str, content: Any) -> Path:
        """Write a JSON file whole or not at all, and return its path."""
        text_file.write(self.at(name), json.dumps(content, indent=1, ensure_ascii=False) + "\n")
        return self.at(name)


@dataclass(frozen=True)
class Outcome:
    """What a step found.

    Attributes:
        said: In a line; ``""``: there was nothing to do.
        paths: Files and folders that it left.
        motion: How the arm was moved; ``None``: it was not.
    """

    said: str = ""
    paths: tuple[Path, ...] = ()
    motion: Moved | None = None


@dataclass(frozen=True)
class Step:
    """One step: its name, and what it does."""

    name: str
    run: Callable[[Work, Logbook, str], Outcome]


def calibrate(work: Work) -> dict[str, Any]:
    """Take the steps that are left, and return the certificate's content.

    Raises:
        ConfigError: The folder was begun with something else, or a file was changed since.
        PlanError: Limits that no motion keeps.
        MotionError: The arm was stopped or must not be moved; the next call goes on from there.
        RecordingError: A recording that serves no purpose.
    """
    with alone_in(work.folder, "--out"):
        book = Logbook.open(work.folder, work.asked)
        for step in all_steps(work.settings):
            entry = book.entry(step.name)
            before = " (done before)" if entry else ""
            if entry is None:
                outcome = step.run(work, book, step.name)
                motion = {} if outcome.motion is None else asdict(outcome.motion)
                entry = book.add(step.name, outcome.said, outcome.paths, motion)
            if entry.said:
                work.report(f"{step.name}: {entry.said}{before}")
    return json_file.load(work.at(CERTIFICATE))


def all_steps(settings: CalibrationSettings) -> tuple[Step, ...]:
    """Return the steps in their order."""
    further = [
        step
        for k in range(1, settings.rounds + 1)
        for step in (
            Step(f"plan further_{k}", partial(_plan_further, k)),
            Step(f"collect further_{k}", partial(_collect, f"further_{k}")),
            Step(f"identify model_{k}", partial(_identify, k)),
            Step(f"diagnose diagnosis_{k}", partial(_diagnose, k)),
        )
    ]
    return (
        Step("plan motion", _plan_first),
        Step("collect motion", partial(_collect, "motion")),
        Step("identify model_0", partial(_identify, 0)),
        Step("plan second", _plan_second),
        Step("collect second", partial(_collect, "second")),
        Step("diagnose diagnosis_0", partial(_diagnose, 0)),
        *further,
        Step("check", _check),
        Step("release", _release),
        Step("certify", _certify),
    )


# Plans.
def _plan_first(work: Work, book: Logbook, step: str) -> Outcome:
    of = work.settings
    design = design_motion(
        work.arm, work.limits, series_basis(of.motion), None, work.seed,
        SolverSettings(seconds=of.search), partial(work.progress, step),
    )  # fmt: skip
    said = f"{of.motion:g} s, condition number {design.condition:.0f}"
    return _planned(work, "motion", design.plan, said)


def _plan_second(work: Work, book: Logbook, step: str) -> Outcome:
    """Plan the motion that is held out: one that teaches what the model does not know yet."""
    of, model = work.settings, _trusted(work, book)
    design = design_motion(
        work.arm, work.limits, series_basis(of.check), model, work.seed + _OTHER,
        SolverSettings(seconds=0.5 * of.search), partial(work.progress, step),
    )  # fmt: skip
    return _planned(work, "second", design.plan, f"{of.check:.3g} s, to be held out")


def _plan_further(k: int, work: Work, book: Logbook, step: str) -> Outcome:
    """Plan a motion that separates causes, or else shows what holds the arm, where it is needed."""
    of, model = work.settings, _trusted(work, book)
    if model is None or (book.motions(f"further_{k - 1}") is None and k > 1):
        return Outcome()
    longest = Straight.within(work.limits.lower, work.limits.upper, work.limits, PART).duration
    after = of.further + of.poses * (of.seconds + 0.5 * longest)
    if Moved.total(book.moved()).seconds + after > of.longest:
        return Outcome(f"no further motion: {of.longest / 60:g} min would be exceeded")
    seed, name = work.seed + k * _OTHER + _OTHER, f"further_{k}"
    findings = work.at(f"diagnosis_{k - 1}.json")
    if json_file.load(findings)["unseparated"]["pairs"]:
        usual = SeparationSettings()
        seconds = min(usual.solver.seconds, of.search)
        design = design_separation(
            load_unseparated(findings, work.at(_model_file(0))), work.limits, of.further,
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


# Motions.
def _collect(name: str, work: Work, book: Logbook, step: str) -> Outcome:
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
                plan, driver, bag, model=_trusted(work, book), rehearse=of.rehearsal, resume=True,
                limits=work.limits_now, consent=work.consent, report=lambda line: None,
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


# What is found.
def _identify(k: int, work: Work, book: Logbook, step: str) -> Outcome:
    bags = _fitted(work, book, k)
    if k and book.motions(f"further_{k}") is None:
        return Outcome()
    fit = identify(bags, work.arm, report=lambda stage, share: work.progress(step, share or 0.0))
    path, sources = work.at(_model_file(k)), ", ".join(bag.name for bag in bags)
    fit.model.save(
        path, f"Identified by dvrk_gravity calibrate from {sources}.\nVerdict: {fit.verdict.words}."
    )
    page = path.with_suffix(".html")
    text_file.write(page, work.pages.identification(fit, sources))
    holdings = {name: vars(each) for name, each in fit.holding.items()}
    values = work.write(path.with_suffix(".json").name, {**fit.to_json(), "holding": holdings})
    found = [100.0 * error.nrmse for error in fit.held_out.values()]
    return Outcome(
        f"{fit.verdict.words}, cross-validated error {min(found):.1f} to {max(found):.0f} % by "
        "joint", (path, uncertainty_file(path), page, values),
    )  # fmt: skip


def _diagnose(k: int, work: Work, book: Logbook, step: str) -> Outcome:
    """Diagnose the first model by all motions that it was not identified from."""
    if (k and book.motions(f"further_{k}") is None) or _trusted(work, book) is None:
        return Outcome()
    model = work.at(_model_file(0))
    bags = [work.at("second"), *_fitted(work, book, k)[1:]]
    path = work.at(f"diagnosis_{k}.json")
    found = diagnose([str(bag) for bag in bags], model, lambda line: work.progress(step, 0.5))
    found = replace(found, files=Files.of(path, model, bags))
    text_file.write(path, found.to_json())
    page = path.with_suffix(".html")
    text_file.write(page, work.pages.diagnosis(found, [bag.name for bag in bags]))
    return Outcome(f"{found.verdict.replace('_', ' ')}: {found.sentence}", (path, page))


def _check(work: Work, book: Logbook, step: str) -> Outcome:
    """Compare the last model with the motion that it was not identified from."""
    last = _last_model(book)
    model = TorqueModel.load(work.at(last))
    found = evaluate(model, [str(work.at("second"))])
    levels = by_errors(model.arm, found.joints, found.coordinates, found.with_friction)
    content = {
        **found.to_json(),
        "levels": {name: each.level for name, each in levels.items()},
        "model": last,
    }
    values = work.write(CHECK, content)
    path = work.at(MODEL)
    simulated = work.rig.simulated
    note = f"\nSimulated: {simulated}. This is not the model of an arm." if simulated else ""
    model.save(path, f"Calibrated by dvrk_gravity: {last}, see certificate.html.{note}")
    each = [100.0 * error.nrmse for error in found.joints.values()]
    return Outcome(
        f"error on the second motion {min(each):.1f} to {max(each):.0f} % by joint",
        (values, path, uncertainty_file(path)),
    )


def _release(work: Work, book: Logbook, step: str) -> Outcome:
    """Release the arm, compensated, at poses that nothing was fitted on."""
    of, rig, path = work.settings, work.rig, work.at(MODEL)
    model = TorqueModel.load(path)
    content: dict[str, Any] = {
        "seconds": of.seconds, "friction": rig.friction, "poses": [], "drift": [],
        "predicted": [], "reduced": None, "apart": 0.0, "why": "", "simulated": rig.simulated,
    }  # fmt: skip
    if model.verdict == POOR:
        content["why"] = f"not released: the model is unfit to compensate with ({model.reason})"
        return Outcome(content["why"], (work.write(RELEASE, content),))
    fitted = np.vstack(
        [
            Recording.load(bag).position[::_EVERY]
            for bag in _fitted(work, book, work.settings.rounds)
        ]
    )
    if not work.consent("the arm is about to be released under compensation: is it watched?"):
        raise MotionError("not released: no consent was given")
    drift: list[list[float]] = []
    moved: list[dict[str, Any]] = []
    poses, apart = np.zeros((0, work.arm.n)), 0.0
    while not len(poses) or len(drift) < len(poses):
        work.progress(step, len(drift) / max(len(poses), 1))
        with rig.driver() as moves:
            driver = KeptDriver(moves, work.limits, work.arm)
            where = driver.connect()
            if not len(poses):
                poses, apart = release_poses(
                    work.arm, work.limits, model, fitted, of, work.seed + _POSES, where
                )
            way = Straight.within(where, poses[len(drift)], work.limits, PART)
            driver.follow(way.at, way.duration)
            driver.hold()
            where = driver.connect()
        drift.append(rig.release(path, where, of.seconds).tolist())
        if not np.isfinite(drift[-1]).all():
            raise MotionError(f"{step}: released, the arm measured no finite positions")
        moved.append(asdict(driver.motion(of.seconds)))
    predicted = None
    if rig.friction != of.friction:
        predicted = predicted_drift(model, poses, of, range(_DRAWS))
    content |= {
        "poses": poses.tolist(), "drift": drift, "apart": apart,
        "predicted": [] if predicted is None else predicted.tolist(),
        "reduced": None if predicted is None else of.friction, "simulated": rig.simulated,
    }  # fmt: skip
    worst = np.max(np.array(drift) / work.arm.scale, axis=1)
    return Outcome(
        f"{len(poses)} poses of {of.seconds:g} s each: drift at most "
        f"{np.degrees(worst.max()):.2f} deg",
        (work.write(RELEASE, content),), Moved.total(moved),
    )  # fmt: skip


def _certify(work: Work, book: Logbook, step: str) -> Outcome:
    last = Path(_last_model(book)).with_suffix(".json").name
    # Intervals of what data do not determine are infinite.
    fit, check, release = (
        json_file.load(work.at(name), finite=False) for name in (last, CHECK, RELEASE)
    )
    found = sorted(name for name in book.files if name.startswith("diagnosis_") and "json" in name)
    diagnosis = json_file.load(work.at(found[-1])) if found else {"findings": [], "ambiguities": []}
    certificate = certify(
        work.arm, work.settings, fit, check, release, diagnosis, Moved.total(book.moved()),
        namespace=work.namespace, simulated=release["simulated"],
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), versions=_versions(),
        files=book.files, model=MODEL,
    )  # fmt: skip
    evaluation = evaluate(work.at(MODEL), [str(work.at("second"))])
    page = work.at(CERTIFICATE).with_suffix(".html")
    text_file.write(page, work.pages.certificate(certificate, evaluation))
    text_file.write(work.at(CERTIFICATE), certificate.to_json())
    return Outcome(certificate.verdict, (page, work.at(CERTIFICATE)))


def _versions() -> dict[str, str]:
    found = {"dvrk_gravity": __version__, "python": platform.python_version()}
    for name in _SOFTWARE:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # as ROS installs Pinocchio
            continue
    return found


def _model_file(k: int) -> str:
    return f"model_{k}.yaml"


def _last_model(book: Logbook) -> str:
    return max(name for name in book.files if name.startswith("model_") and name.endswith(".yaml"))


def _fitted(work: Work, book: Logbook, rounds: int) -> list[Path]:
    """Return the recordings that a model is identified from."""
    names = ["motion", *(f"further_{k}" for k in range(1, rounds + 1))]
    return [work.at(name) for name in names if book.motions(name) is not None]


def _trusted(work: Work, book: Logbook) -> TorqueModel | None:
    """Return the last model, ``None`` before the first, and of one that is unfit."""
    if book.entry("identify model_0") is None:
        return None
    model = TorqueModel.load(work.at(_last_model(book))).physical()
    return None if model.verdict == POOR else model
