"""An arm is identified once, and then diagnosed in many recordings with that model."""

from __future__ import annotations

import json
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Coordinates, Recording
from testing.hidden_parts import Hidden
from testing.score import Outcome, report, run_trial

Trial = tuple[str, int, Callable[[], tuple[Recording, Hidden, float]]]
"""Effect, seed, and what records it: the recording, what is hidden in it, and how large."""


@dataclass
class Session:
    """What came of one arm.

    Attributes:
        engine: Where its recordings come from.
        arm: Which arm.
        seed: Its seed; of a real one 0.
        identify: Seconds of the identification.
        residual: What the model leaves of each joint on held-out parts of the calibration, RMS.
        share: The same as a part of the joint's torque.
        outcomes: Of the trials.
        failure: Why there are none, or no more.
    """

    engine: str
    arm: str
    seed: int
    identify: float = 0.0
    residual: list[float] = field(default_factory=list)
    share: list[float] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)
    failure: str = ""

    def add(self, outcome: Outcome) -> None:
        """Add a trial, and say how it went."""
        self.outcomes.append(outcome)
        _say(str(outcome))


@dataclass(frozen=True, eq=False)
class Laboratory:
    """An arm that can be recorded.

    Attributes:
        arm: What the package knows of it.
        calibration: What it is identified from.
        trials: What is diagnosed, given the model.
        coordinates: Of the calibration; ``None``: found out.
        through_file: Whether the model is saved and loaded again before it diagnoses.
    """

    arm: Arm
    calibration: Recording
    trials: Callable[[TorqueModel], Iterable[Trial]]
    coordinates: Coordinates | None = None
    through_file: bool = False


def hold(session: Session, prepare: Callable[[], Laboratory]) -> Session:
    """Identify and go through the trials; what stops them is in the session, not raised."""
    try:
        laboratory = prepare()
        model = _identified(session, laboratory)
        for effect, seed, make in laboratory.trials(model):
            outcome = Outcome(session.engine, session.arm, seed, effect)
            session.add(run_trial(outcome, make, model))
    except Exception as error:
        why = error if isinstance(error, ConfigError) else traceback.format_exc(limit=4)
        session.failure = f"{session.engine} {session.arm} {session.seed}: left out: {why}"
        _say(session.failure)
    return session


def save(sessions: Sequence[Session], path: str) -> None:
    """Write every trial as JSON."""
    with open(path, "w", encoding="utf-8") as stream:
        json.dump([asdict(session) for session in sessions], stream, indent=1, default=float)


def tell(title: str, sessions: Sequence[Session], path: str | None) -> None:
    """Write every trial as JSON, if there is a path for it, and print the table."""
    if path:
        save(sessions, path)
    print(table(title, sessions))


def table(title: str, sessions: Sequence[Session]) -> str:
    """Return the table of all trials, and why there are none of some arms."""
    outcomes = [outcome for session in sessions for outcome in session.outcomes]
    seconds = {
        f"{session.arm} {session.seed}": session.identify
        for session in sessions
        if session.identify
    }
    failures = [session.failure for session in sessions if session.failure]
    return "\n".join([report(title, outcomes, seconds), *failures])


def _identified(session: Session, laboratory: Laboratory) -> TorqueModel:
    start = time.monotonic()
    fit = identify(laboratory.calibration, laboratory.arm, laboratory.coordinates)
    session.identify = time.monotonic() - start
    session.residual = [error.rmse for error in fit.held_out.values()]
    session.share = [error.nrmse for error in fit.held_out.values()]
    shares = " ".join(f"{100 * share:.1f}" for share in session.share)
    _say(
        f"{session.engine} {session.arm} {session.seed}: identified in {session.identify:.1f} s, "
        f"{fit.verdict.words}; leaves {shares} % of the joints' torques"
    )
    if not laboratory.through_file:
        return fit.model
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.yaml"
        fit.model.save(path)
        return TorqueModel.load(path)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
