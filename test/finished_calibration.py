"""One finished calibration of a small arm, interrupted after every step; many tests read it."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import yaml
from path_driver import PathDriver

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import (
    CalibrationSettings,
    Logbook,
    MotionTally,
    Pages,
    Work,
    all_steps,
    calibrate,
    draw_arm,
)
from dvrk_gravity.effects import State
from dvrk_gravity.files import json_file
from dvrk_gravity.planning import PlanLimits
from dvrk_gravity.report import certificate_page
from dvrk_gravity.simulate import PlantFile

FILE = {
    "name": "small",
    "joints": [
        {"name": "yaw", "alpha": 90, "a": 0.0, "d": 0.1, "offset": 0, "lower": -100,
         "upper": 100, "effort_limit": 20},
        {"name": "pitch", "alpha": 0, "a": 0.3, "d": 0.0, "offset": 0, "lower": -70,
         "upper": 80, "effort_limit": 15},
    ],
    "base_rpy": [60, 0, 0],
}  # fmt: skip
BRIEF = CalibrationSettings(
    motion_duration=10.0, check_duration=9.0, further_duration=9.0, rounds=1, search=2, poses=3,
    release_duration=0.5, rehearsal=False,
)  # fmt: skip
ASKED = {"--arm": "small", "--seed": "1"}
RELEASED = MotionTally(60.0, 0.0, 60_000, 0.9, "velocity of yaw")


class KilledError(Exception):
    """What ends a process here."""


class PathRig:
    """An arm that is where it is commanded to be, has its plant's efforts, and does not drift."""

    simulated, friction = "a path", BRIEF.friction

    def __init__(self, arm: Arm, resumes: bool = True) -> None:
        self.resumes = resumes
        self._arm, self._truth = arm, draw_arm(PlantFile.of(arm), 1).model
        self._at = 0.5 * (arm.lower + arm.upper)
        self.released: list[np.ndarray] = []
        self.on_release: Callable[[], None] = lambda: None
        self.drift = np.zeros(arm.n)

    def driver(self) -> PathDriver:
        random = np.random.default_rng(len(self.released))

        def torque(q, qd, qdd) -> np.ndarray:
            exact = self._truth.torque_at(State(q, qd, qdd))
            return exact + 0.003 * self._arm.effort_limit * random.normal(size=q.shape)

        return PathDriver(self._arm, self._at, torque=torque)

    def release(self, model: Path, pose: np.ndarray, seconds: float) -> np.ndarray:
        self.released.append(pose)
        self._at = pose
        self.on_release()
        return self.drift


@dataclass(frozen=True)
class Finished:
    """A calibration that was interrupted after every step, and the lines that each process said.

    Its folder is to be read only.
    """

    folder: Path
    arm: Arm
    runs: list[list[str]]

    def work(self, folder: Path, **other) -> Work:
        """Return the same calibration in another folder, or otherwise."""
        return work_in(folder, self.arm, **other)

    def before(self, step: str, folder: Path) -> Path:
        """Return a copy in which a step, and those after it, are not done."""
        shutil.copytree(self.folder, folder)
        book = json_file.load(folder / "calibration.json")
        done = [entry["step"] for entry in book["steps"]].index(step)
        (folder / "calibration.json").write_text(json.dumps(book | {"steps": book["steps"][:done]}))
        return folder

    def content(self, name: str) -> dict:
        """Return what is in a file."""
        return json_file.load(self.folder / name, finite=False)

    def take(self, name: str, folder: Path, changed: bool = False, **other):
        """Take a step once more in a folder that is as before it, and return its outcome.

        Files of earlier steps may have been ``changed``.
        """
        (step,) = (step for step in all_steps(BRIEF) if step.name == name)
        if changed:
            done = Logbook.open(self.folder, ASKED).entries
            left = [each.step for each in done].index(name)
            book = Logbook(folder, ASKED, done[:left])
        else:
            book = Logbook.open(folder, ASKED)
        return step.run(self.work(folder, **other), book, name)


def work_in(folder: Path, arm: Arm, report=lambda line: None, **other) -> Work:
    """Return a brief calibration."""
    pages = Pages(
        lambda plan: b"picture", lambda fit, name: "fit", lambda found, names: "found",
        lambda certificate, evaluation: certificate_page(certificate, evaluation, arm),
    )  # fmt: skip
    rig = other.pop("rig", None) or PathRig(arm)
    limits = PlanLimits.of(arm)
    how = {"settings": BRIEF, "report": report, **other}
    return Work(folder, dict(ASKED), arm, limits, rig, pages, "/SMALL", 1, **how)


@cache
def finished_calibration() -> Finished:
    """Return it, made once for all tests; each process dies when it has noted a step."""
    place = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, place)
    (place / "small.yaml").write_text(yaml.safe_dump(FILE))
    arm, folder = Arm.load(place / "small.yaml"), place / "calibration"
    folder.mkdir()
    runs: list[list[str]] = []
    while len(runs) < 20:
        lines: list[str] = []
        runs.append(lines)

        def report(line: str, lines=lines) -> None:
            lines.append(line)
            if not line.endswith("(done before)"):
                (folder / ".model.yaml.x1y2z3_4").write_text("half")
                raise KilledError

        try:
            calibrate(work_in(folder, arm, report))
        except KilledError:
            continue
        break
    return Finished(folder, arm, runs)
