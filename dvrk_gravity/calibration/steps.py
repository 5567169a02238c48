"""The steps of a calibration, in their order; each goes from files that are there to others."""

from __future__ import annotations

import platform
import re
from dataclasses import asdict, replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity import __version__
from dvrk_gravity.calibration.certificate import certify, largest_drift
from dvrk_gravity.calibration.checked_driver import CheckedDriver
from dvrk_gravity.calibration.logbook import Logbook
from dvrk_gravity.calibration.motion_steps import (
    collect_motion,
    plan_first,
    plan_further,
    plan_second,
    poses_to_release_at,
)
from dvrk_gravity.calibration.release import PART, friction_hold_share, settle_constants
from dvrk_gravity.calibration.settings import CalibrationSettings
from dvrk_gravity.calibration.tally import MotionTally
from dvrk_gravity.calibration.work import (
    Outcome,
    Step,
    Work,
    fitted_bags,
    last_model,
    model_file,
    trusted_model,
)
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.diagnosis import Files, diagnose
from dvrk_gravity.files import json_file, text_file
from dvrk_gravity.files.lock import lock_folder
from dvrk_gravity.identification import POOR, by_errors, evaluate, identify
from dvrk_gravity.model import TorqueModel, uncertainty_file
from dvrk_gravity.planning import Straight
from dvrk_gravity.recording import Coordinates

CHECK, CHECKED = "check.json", "checked.yaml"
RELEASE, MODEL = "release.json", "model.yaml"
CERTIFICATE = "certificate.json"
MEASURED: Coordinates = "joint"
"""Of what is collected: the compensator takes the same readings for the joints'."""
_SOFTWARE = ("numpy", "scipy", "pin")


def calibrate(work: Work) -> dict[str, Any]:
    """Take the steps that are left, and return the certificate's content.

    Raises:
        ConfigError: The folder was begun with something else, or a file was changed since.
        PlanError: Limits that no motion keeps.
        MotionError: The arm was stopped or must not be moved; the next call goes on from there.
        RecordingError: A recording that serves no purpose.
    """
    with lock_folder(work.folder, "--out"):
        book = Logbook.open(work.folder, work.asked)
        for step in all_steps(work.settings):
            entry = book.entry(step.name)
            before = " (done before)" if entry else ""
            if entry is None:
                book.require_unchanged()
                outcome = step.run(work, book, step.name)
                motion = {} if outcome.motion is None else asdict(outcome.motion)
                entry = book.add(step.name, outcome.summary, outcome.paths, motion)
            if entry.said:
                work.report(f"{step.name}: {entry.said}{before}")
    return json_file.load(work.at(CERTIFICATE))


def all_steps(settings: CalibrationSettings) -> tuple[Step, ...]:
    """Return the steps in their order."""
    further = [
        step
        for k in range(1, settings.rounds + 1)
        for step in (
            Step(f"plan further_{k}", partial(plan_further, k)),
            Step(f"collect further_{k}", partial(collect_motion, f"further_{k}")),
            Step(f"identify model_{k}", partial(_identify, k)),
            Step(f"diagnose diagnosis_{k}", partial(_diagnose, k)),
        )
    ]
    return (
        Step("plan motion", plan_first),
        Step("collect motion", partial(collect_motion, "motion")),
        Step("identify model_0", partial(_identify, 0)),
        Step("plan second", plan_second),
        Step("collect second", partial(collect_motion, "second")),
        Step("diagnose diagnosis_0", partial(_diagnose, 0)),
        *further,
        Step("check", _check),
        Step("release", _release),
        Step("certify", _certify),
    )


def _identify(k: int, work: Work, book: Logbook, step: str) -> Outcome:
    bags = fitted_bags(work, book, k)
    if k and book.recorded(f"further_{k}") is None:
        return Outcome()
    fit = identify(
        bags, work.arm, MEASURED, report=lambda stage, share: work.progress(step, share, stage),
        least_gain=work.settings.least_gain,
    )  # fmt: skip
    path, sources = work.at(model_file(k)), ", ".join(bag.name for bag in bags)
    fit.model.save(
        path, f"Identified by dvrk_gravity calibrate from {sources}.\nVerdict: {fit.verdict.words}."
    )
    page = path.with_suffix(".html")
    text_file.write(page, work.pages.identification(fit, sources))
    holdings = {name: vars(each) for name, each in fit.holding.items()}
    held = friction_hold_share(fit, work.limits, work.settings, work.seed + k)
    values = work.write(
        path.with_suffix(".json").name,
        {
            **fit.to_json(),
            "holding": holdings,
            "held": held,
        },
    )
    found = [100.0 * error.nrmse for error in fit.held_out.values()]
    return Outcome(
        f"{fit.verdict.words}, cross-validated error {min(found):.1f} to {max(found):.0f} % by "
        "joint", (path, uncertainty_file(path), page, values),
    )  # fmt: skip


def _diagnose(k: int, work: Work, book: Logbook, step: str) -> Outcome:
    """Diagnose the first model by all motions that it was not identified from."""
    if (k and book.recorded(f"further_{k}") is None) or trusted_model(work, book) is None:
        return Outcome()
    model = work.at(model_file(0))
    bags = [work.at("second"), *fitted_bags(work, book, k)[1:]]
    path = work.at(f"diagnosis_{k}.json")
    found = diagnose(
        [str(bag) for bag in bags], model, lambda stage: work.progress(step, None, stage),
        coordinates=MEASURED,
    )  # fmt: skip
    found = replace(found, files=Files.of(path, model, bags))
    text_file.write(path, found.to_json())
    page = path.with_suffix(".html")
    text_file.write(page, work.pages.diagnosis(found, [bag.name for bag in bags]))
    named = found.findings or found.cannot_judge
    verdict = f"{found.verdict.replace('_', ' ')}: " if named else ""
    return Outcome(f"{verdict}{found.sentence}", (path, page))


def _check(work: Work, book: Logbook, step: str) -> Outcome:
    """Compare the last model with the motion that it was not identified from."""
    last = last_model(book)
    model = TorqueModel.load(work.at(last))
    found = evaluate(model, [str(work.at("second"))], MEASURED)
    levels = by_errors(model.arm, found.joints, found.coordinates, found.with_friction)
    content = {
        **found.to_json(),
        "levels": {name: each.level for name, each in levels.items()},
        "model": last,
    }
    values = work.write(CHECK, content)
    path = work.at(CHECKED)
    model.save(path, _comment(work, last))
    each = [100.0 * error.nrmse for error in found.joints.values()]
    return Outcome(
        f"error on the second motion {min(each):.1f} to {max(each):.0f} % by joint",
        (values, path, uncertainty_file(path)),
    )


def _comment(work: Work, last: str) -> str:
    """Return the comment in a calibrated model's file."""
    simulated = work.rig.simulated
    note = f"\nSimulated: {simulated}. This is not the model of an arm." if simulated else ""
    return f"Calibrated by dvrk_gravity: {last}, see certificate.html.{note}"


def _release(work: Work, book: Logbook, step: str) -> Outcome:
    """Release the arm, compensated, at poses that nothing was fitted on."""
    of, rig = work.settings, work.rig
    path = work.at(CHECKED if CHECKED in book.files else MODEL)  # as earlier versions named it
    model = TorqueModel.load(path)
    content: dict[str, Any] = {
        "seconds": of.release_duration, "friction": rig.friction, "poses": [], "drift": [],
        "apart": 0.0, "why": "", "simulated": rig.simulated,
    }  # fmt: skip
    if model.verdict == POOR:
        content["why"] = f"not released: the model is unfit to compensate with ({model.reason})"
        return Outcome(
            content["why"], (work.write(RELEASE, content), *_write_named_model(work, book, model))
        )
    if not work.consent("the arm is about to be released under compensation: is it watched?"):
        raise MotionError("not released: no consent was given")
    drift: list[list[float]] = []
    moved: list[dict[str, Any]] = []

    def note(motion: MotionTally) -> None:
        book.note_motion(MotionTally.total([*moved, asdict(motion)]))

    poses, apart = np.zeros((0, work.arm.n)), 0.0
    while not len(poses) or len(drift) < len(poses):
        work.progress(step, len(drift) / max(len(poses), 1))
        book.require_unchanged()  # each release reads the model again
        if work.limits_now is not None:
            work.limits_now()
        with rig.driver() as moves:
            driver = CheckedDriver(moves, work.limits, work.arm, note)
            where = driver.connect()
            if not len(poses):
                poses, apart = poses_to_release_at(work, book, model, where)
            way = Straight.within(where, poses[len(drift)], work.limits, PART)
            driver.follow(way.at, way.duration)
            driver.hold()
            where = driver.connect()
            note(driver.motion(of.release_duration))
        drift.append(rig.release(path, where, of.release_duration).tolist())
        if not np.isfinite(drift[-1]).all():
            raise MotionError(f"{step}: released, the arm measured no finite positions")
        moved.append(asdict(driver.motion(of.release_duration)))
    content |= {
        "poses": poses.tolist(), "drift": drift, "apart": apart, "simulated": rig.simulated,
    }  # fmt: skip
    worst = np.max(np.array(drift) / work.arm.scale, axis=1)
    settled = settle_constants(model, poses, np.array(drift), of.max_drift)
    return Outcome(
        f"{len(poses)} poses of {of.release_duration:g} s each: drift "
        f"{largest_drift(float(worst.max()))}",
        (work.write(RELEASE, content), *_write_named_model(work, book, settled)),
        MotionTally.total(moved),
    )  # fmt: skip


def _write_named_model(work: Work, book: Logbook, model: TorqueModel) -> tuple[Path, Path]:
    """Write the model under the name that a user takes, and return its files."""
    path = work.at(MODEL)
    model.save(path, _comment(work, last_model(book)))
    return path, uncertainty_file(path)


def _certify(work: Work, book: Logbook, step: str) -> Outcome:
    last = Path(last_model(book)).with_suffix(".json").name
    # Intervals of what data do not determine are infinite.
    fit, check, release = (
        json_file.load(work.at(name), finite=False) for name in (last, CHECK, RELEASE)
    )
    diagnoses = sorted(each for each in book.files if re.fullmatch(r"diagnosis_\d+\.json", each))
    diagnosis: dict[str, Any] = {"findings": [], "ambiguities": []}
    if diagnoses:
        diagnosis = json_file.load(work.at(diagnoses[-1]))
    certificate = certify(
        work.arm, work.settings, fit, check, release, diagnosis, book.total,
        namespace=work.namespace, simulated=release["simulated"],
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), versions=_versions(book),
        files=book.files, model=MODEL,
    )  # fmt: skip
    evaluation = evaluate(work.at(MODEL), [str(work.at("second"))], MEASURED)
    page = work.at(CERTIFICATE).with_suffix(".html")
    text_file.write(page, work.pages.certificate(certificate, evaluation))
    text_file.write(work.at(CERTIFICATE), certificate.to_json())
    return Outcome(certificate.verdict, (page, work.at(CERTIFICATE)))


def _versions(book: Logbook) -> dict[str, str]:
    """Return the versions that the steps were made with; of other software, that of now."""
    own = dict.fromkeys([*(entry.version for entry in book.entries), __version__])
    found = {"dvrk_gravity": ", ".join(own), "python": platform.python_version()}
    for name in _SOFTWARE:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # as ROS installs Pinocchio
            continue
    return found
