"""One calibration: what is asked for, what does it, and what its steps leave for each other."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration.certificate import Certificate
from dvrk_gravity.calibration.logbook import Logbook
from dvrk_gravity.calibration.rig import Rig
from dvrk_gravity.calibration.settings import CalibrationSettings
from dvrk_gravity.calibration.tally import MotionTally
from dvrk_gravity.diagnosis import Diagnosis
from dvrk_gravity.files import text_file
from dvrk_gravity.identification import POOR, Evaluation, Fit
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import Plan, PlanLimits


class StepProgress(Protocol):
    """Receives a step and its part that is done; ``None``: not known."""

    def __call__(self, step: str, part: float | None, stage: str = "") -> None:
        """Show it.

        Args:
            step: Its name.
            part: Of it, or of the stage, from 0 to 1.
            stage: As :func:`identify` and :func:`diagnose` name it.
        """


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
        limits_now: The same limits, asked before every phase of a motion and every release; raises
            MotionError if they have changed.
        consent: Asked before the arm moves.
        report: Receives lines.
        progress: Receives a step and its part that is done; or that of a stage, and its name.
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
    progress: StepProgress = lambda step, part, stage="": None

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
        summary: In a line; ``""``: there was nothing to do.
        paths: Files and folders that it left.
        motion: How the arm was moved; ``None``: it was not.
    """

    summary: str = ""
    paths: tuple[Path, ...] = ()
    motion: MotionTally | None = None


@dataclass(frozen=True)
class Step:
    """One step: its name, and what it does."""

    name: str
    run: Callable[[Work, Logbook, str], Outcome]


def model_file(k: int) -> str:
    """Return the name of the model after so many further motions."""
    return f"model_{k}.yaml"


def last_model(book: Logbook) -> str:
    """Return the name of the last model that was identified."""
    return max(name for name in book.files if name.startswith("model_") and name.endswith(".yaml"))


def fitted_bags(work: Work, book: Logbook, rounds: int) -> list[Path]:
    """Return the recordings that a model is identified from."""
    names = ["motion", *(f"further_{k}" for k in range(1, rounds + 1))]
    return [work.at(name) for name in names if book.recorded(name) is not None]


def trusted_model(work: Work, book: Logbook) -> TorqueModel | None:
    """Return the last model, ``None`` before the first, and of one that is unfit."""
    if book.entry("identify model_0") is None:
        return None
    model = TorqueModel.load(work.at(last_model(book))).physical()
    return None if model.verdict == POOR else model
