"""From a plan to its recording: approach, rehearse, move, record; whole or not at all."""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.collecting.driver import Driver, Path, States
from dvrk_gravity.collecting.effort_watch import EffortWatch
from dvrk_gravity.collecting.journal import JOINING, MOTION, REHEARSAL, Journal, discard
from dvrk_gravity.collecting.pace import PacedMotion, resume_motion
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.errors import DvrkGravityError, RecordingError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import UNSEEN, Plan, PlanLimits, Slack, Straight, worst_violation
from dvrk_gravity.recording import JOINT_STATE, BagWriter
from dvrk_gravity.units import quantity


@dataclass(frozen=True)
class CollectSettings:
    """How a plan is carried out.

    Attributes:
        rehearsal: Speed of the rehearsal, of the motion's. Chosen: a hundredth of its
            accelerations, so that what is in the way is met gently.
        approach: Part of the limits that an approach uses: it passes through untested space.
        disturbed: Time before a stop whose recording is dropped, s. Chosen: what stops an arm lasts
            a tenth of a second before it is noticed, and may pull at it for longer.
        mark: Interval of the points at which a motion can be resumed, s. Chosen.
        message: Size of a recorded message, bytes: a JointState of seven joints and its row.
        rate: Greatest rate of messages, Hz: a console's.
    """

    rehearsal: float = 0.1
    approach: float = 0.5
    disturbed: float = 2.0
    mark: float = 1.0
    message: float = 500.0
    rate: float = 1000.0


class MotionStoppedError(MotionError):
    """A motion was stopped; what was recorded is kept for ``resume``.

    Attributes:
        phase: ``approach``, ``rehearsal`` or ``motion``.
        moment: s of the motion.
        why: Reason.
    """

    def __init__(self, phase: str, moment: float, why: str, text: str) -> None:
        """Store the parts."""
        self.phase, self.moment, self.why = phase, moment, why
        super().__init__(text)


@dataclass(frozen=True)
class CollectedRecording:
    """What was recorded.

    Attributes:
        bag: Folder of the rosbag2.
        samples: Messages in it.
        seconds: Planned duration of the motions, s.
        excess_time: Excess over it, s of the arm's clock: of pauses of this computer.
        parts: Goes that it was recorded in: more than one if it was resumed.
    """

    bag: FilePath
    samples: int
    seconds: float
    excess_time: float
    parts: int


def collect(
    plan: Plan | Sequence[Plan],
    driver: Driver,
    out: str | FilePath,
    *,
    model: TorqueModel | None = None,
    settings: CollectSettings = CollectSettings(),
    rehearse: bool = True,
    resume: bool = False,
    limits: Callable[[], PlanLimits] | None = None,
    look: Callable[[Path, float], None] = lambda path, duration: None,
    consent: Callable[[str], bool] = lambda question: True,
    report: Callable[[str], None] = print,
    progress: Callable[[str, float], None] = lambda phase, part: None,
) -> CollectedRecording:
    """Move an arm along a plan, or several one after the other, and record it.

    Before each motion the arm approaches its beginning on a straight line, and goes through it at
    a tenth of its speed, unrecorded. If anything stops it, the arm is held, and what was recorded
    is kept beside ``out``; ``resume`` goes on from there: the arm approaches a point of the motion
    somewhat before, and takes it up from rest.

    Args:
        plan: What to do.
        driver: Moves the arm; entered by the caller.
        out: rosbag2 to write; appears when it is whole.
        model: Of the arm: efforts are watched against its torque and their 95 % band.
        settings: See :class:`CollectSettings`.
        rehearse: Whether to rehearse.
        resume: Go on with what an earlier process has begun; without one, begin.
        limits: What must be kept now, asked before every phase; ``None``: the plan's own.
        look: Looks at a way that the driver is to follow, and its duration, s, or raises
            MotionError. It may take its time: the arm is not on its way then.
        consent: Asked before the arm moves, and before it moves at full speed.
        report: Receives a line for each phase.
        progress: Receives phase and completed part.

    Raises:
        RecordingError: ``out`` exists, cannot be written, or is unfinished.
        ConfigError: What was begun is of another plan or arm.
        MotionStoppedError: The arm was stopped, or must not be moved, on the way.
        MotionError: The arm must not be moved, or consent was not given.
    """
    plans = [plan] if isinstance(plan, Plan) else list(plan)
    with Journal.begin(FilePath(out), plans, driver.topic, resume) as journal:
        seconds = sum(each.duration for each in plans)
        _require_space(journal, seconds, settings)
        work = _Collection(
            plans, driver, journal, model, settings, limits, look, consent, report, progress
        )
        if journal.found:
            report(f"going on with {journal.out}, which {journal.place()}")
        elif resume:
            report(f"nothing to resume at {journal.out}: from the beginning")
        if journal.phase != JOINING:
            work.move(rehearse)
            journal.enter(journal.motion, JOINING, 0.0, approaching=False)
        samples, parts = journal.join(plans, 2.0 * settings.mark), len(journal.parts)
        discard(journal.out)
        return CollectedRecording(journal.out, samples, seconds, work.excess_time, parts)


class _Collection:
    """A collection that is under way."""

    def __init__(
        self,
        plans: list[Plan],
        driver: Driver,
        journal: Journal,
        model: TorqueModel | None,
        settings: CollectSettings,
        limits: Callable[[], PlanLimits] | None,
        look: Callable[[Path, float], None],
        consent: Callable[[str], bool],
        report: Callable[[str], None],
        progress: Callable[[str, float], None],
    ) -> None:
        self._plans, self._driver, self._journal = plans, driver, journal
        self._model, self._settings, self._limits = model, settings, limits
        self._look, self._consent = look, consent
        self._report, self._progress = report, progress
        self._checked: list[PlanLimits | None] = [None] * len(plans)
        self._turns = np.zeros(plans[0].arm.n)  # of endless joints, rad
        self.excess_time = 0.0

    def move(self, rehearse: bool) -> None:
        """Carry out what is left of the plans."""
        journal, first = self._journal, self._journal.motion
        for number in range(first, len(self._plans)):
            self._limits_now(number)  # refuses what would stop the arm later
        rehearsing = rehearse and not journal.rehearsed
        self._ask(
            f"the arm is about to move{' slowly, in rehearsal' if rehearsing else ''}: is its room "
            "free, and a hand at the emergency stop?"
        )
        where = self._connect(first)
        stopped: BaseException | None = None
        try:
            with journal.new_part() as bag:
                bag.add_topic(self._driver.topic, JOINT_STATE)
                stopped = self._motions(bag, first, where, rehearse)
        except RecordingError as error:  # its end could not be written
            stopped = stopped or self._note(error)
        if isinstance(stopped, KeyboardInterrupt):
            self._report(self._stop_text())
            raise stopped
        if stopped is not None:
            raise MotionStoppedError(journal.phase, journal.moment, journal.why, self._stop_text())

    def _motions(
        self, bag: BagWriter, first: int, where: Array, rehearse: bool
    ) -> BaseException | None:
        """Go through the motions; return what stopped them, once the arm is held."""
        try:
            for number in range(first, len(self._plans)):
                where = self._motion(bag, number, where, rehearse)
        except BrokenPipeError:
            raise
        except (DvrkGravityError, OSError, KeyboardInterrupt) as error:
            return self._note(error)
        finally:
            self._driver.hold()  # before the bag is closed, which may take time
        return None

    def _motion(self, bag: BagWriter, number: int, where: Array, rehearse: bool) -> Array:
        """Rehearse a motion, and go through it recorded, from where the arm is or stopped."""
        journal, of = self._journal, self._settings
        goes_on = journal.found and number == journal.motion
        begins: list[float] = []
        if goes_on and journal.phase == MOTION:
            begins = journal.resume_points(0.0 if journal.approaching else of.disturbed)
        if rehearse and not (goes_on and journal.rehearsed):
            at = begins
            if goes_on and journal.phase == REHEARSAL:
                at = [max(journal.moment - of.disturbed, 0.0)]
            self._phase(bag, number, REHEARSAL, self._remaining(number, at, of.rehearsal), where)
            self._driver.hold()
            journal.rehearsed = True
            journal.enter(number, MOTION, max(begins, default=0.0), approaching=True)
            self._ask(f"rehearsed: now at {1.0 / of.rehearsal:g} times that speed?")
            where = self._connect(number)
        paced = self._remaining(number, begins)
        journal.drop_from(number, paced.begin)
        self.excess_time += self._phase(bag, number, MOTION, paced, where)
        if number + 1 < len(self._plans):
            self._driver.hold()
            where = self._connect(number + 1)
        return where

    def _remaining(self, number: int, begins: list[float], speed: float = 1.0) -> PacedMotion:
        """Return what is left of a motion, from one of these moments on, s."""
        plan = self._plans[number]
        return resume_motion(plan.motion, begins, self._limits_now(number), plan.arm, speed)

    def _connect(self, number: int) -> Array:
        """Return where the arm rests, an endless joint as if it were in its limits' turn."""
        where = self._driver.connect()
        self._turns = self._limits_now(number).turns(self._plans[number].arm, where)
        return where - self._turns

    def _phase(
        self, bag: BagWriter, number: int, phase: str, paced: PacedMotion, where: Array
    ) -> float:
        """Approach, and follow a motion; return its excess over the planned time, s."""
        plan, journal, driver = self._plans[number], self._journal, self._driver
        recorded = phase == MOTION
        of = f" {number + 1} of {len(self._plans)}" if len(self._plans) > 1 else ""
        journal.enter(number, phase, paced.begin, approaching=True)
        limits = self._require_paced(number, paced)
        while True:
            approach = Straight.within(where, paced.at(0.0)[0], limits, self._settings.approach)
            if beyond := worst_violation(approach, limits, plan.arm, self._model, UNSEEN):
                raise MotionError(
                    f"the straight way to the plan's beginning {_excess(beyond)}: move the arm "
                    "nearer to the beginning by hand"
                )
            there, through = self._in_recorded_turns(approach), self._in_recorded_turns(paced)
            self._look(there, approach.duration)
            # Before the approach: between the two, the arm is under command and waits for nothing.
            self._look(through, paced.duration)
            self._follow(number, f"approach{of}", approach, there, limits)
            if _same(self._limits_now(number), limits):
                break
            driver.hold()  # they were changed meanwhile, and are kept: to look at all takes time
            limits, where = self._require_paced(number, paced), self._connect(number)
        journal.enter(number, phase, paced.begin, approaching=False)
        due = paced.begin

        def progress(part: float) -> None:
            nonlocal due
            journal.moment = paced.moment(part * paced.duration)
            if journal.moment >= due:
                journal.mark(journal.moment, bag)
                due = journal.moment + self._settings.mark

        def record(data: bytes) -> None:
            if journal.moment >= paced.begin:  # not while it takes up a motion's speed
                bag.write(driver.topic, JOINT_STATE, data, time.time_ns())

        name = f"{phase}{of}{', recorded' if recorded else ''}"
        longer = self._follow(
            number, name, paced, through, limits, record if recorded else None, progress
        )
        journal.mark(plan.duration, bag)
        return longer

    def _in_recorded_turns(self, way: Straight | PacedMotion) -> Path:
        """Return a way in the turns in which endless joints are."""
        turns = self._turns

        def turned(time: float | Array) -> States:
            position, velocity, acceleration = way.at(time)
            return position + turns, velocity, acceleration

        return turned

    def _follow(
        self, number: int, name: str, way: Straight | PacedMotion, path: Path, limits: PlanLimits,
        record: Callable[[bytes], None] | None = None,
        progress: Callable[[float], None] = lambda part: None,
    ) -> float:  # fmt: skip
        """Drive the arm along a way, watched; return its excess over the planned time, s."""

        def shown(part: float) -> None:
            progress(part)
            self._progress(name, part)

        self._report(f"{name}: {way.duration:.0f} s; Ctrl-C holds the arm")
        self._progress(name, 0.0)
        watch = EffortWatch(way.at, self._plans[number].arm, limits.effort, self._model)
        return self._driver.follow(path, way.duration, record, shown, watch)

    def _require_paced(self, number: int, paced: PacedMotion) -> PlanLimits:
        """Return the limits of now, which a motion keeps at its pace, too."""
        limits, plan = self._limits_now(number), self._plans[number]
        if not paced.whole:  # its places are the plan's
            of_joints = replace(limits, boxes=())
            if beyond := worst_violation(paced, of_joints, plan.arm, self._model):
                raise MotionError(f"the plan at this pace {_excess(beyond)}: plan again")
        return limits

    def _limits_now(self, number: int) -> PlanLimits:
        """Return the plan's limits and those of now, which it keeps.

        Limits that were raised since the plan was made raise nothing.
        """
        plan = self._plans[number]
        limits = plan.limits if self._limits is None else plan.limits.and_those(self._limits())
        if not _same(limits, self._checked[number]):
            if beyond := worst_violation(plan.motion, limits, plan.arm, self._model):
                raise MotionError(f"the plan {_excess(beyond)}: plan again within these limits")
            self._checked[number] = limits
        return limits

    def _ask(self, question: str) -> None:
        if not self._consent(question):
            raise MotionError("not moved: no consent was given")

    def _note(self, error: BaseException) -> BaseException:
        """Save where and why it stopped; a full disk keeps the state of a second before."""
        self._journal.why = str(error) or "interrupted"
        with contextlib.suppress(OSError):
            self._journal.save()
        return error

    def _stop_text(self) -> str:
        journal = self._journal
        return f"{journal.out}: {journal.place()}. Kept in {journal.folder}; --resume goes on"


def _same(limits: PlanLimits, others: PlanLimits | None) -> bool:
    """Return whether two limits are equal."""
    return others is not None and (
        (limits.combinations, limits.boxes) == (others.combinations, others.boxes)
        and all(
            np.array_equal(getattr(limits, name), getattr(others, name))
            for name in ("lower", "upper", "velocity", "acceleration", "effort")
        )
    )


def _excess(beyond: Slack) -> str:
    """Return in words that a limit is exceeded, and by how much."""
    by = quantity(-beyond.left, beyond.unit)
    if beyond.limit == "distance":
        return f"takes {beyond.of}, {by} inside"
    return f"exceeds the limit of {beyond.limit} of {beyond.of} by {by}"


def _require_space(journal: Journal, seconds: float, settings: CollectSettings) -> None:
    """Refuse a disk without room for the parts and for the bag that joins them."""
    needed = 2.0 * seconds * settings.rate * settings.message
    free = shutil.disk_usage(journal.out.parent).free
    if free < needed:
        raise RecordingError(
            journal.out, f"needs up to {1e-6 * needed:.0f} MB, expected them on a disk that has "
            f"{1e-6 * free:.0f} MB left"
        )  # fmt: skip
