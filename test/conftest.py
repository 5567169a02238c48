"""Fixtures: a ROS domain of one's own, and the arm's side of the topics."""

from __future__ import annotations

import ast
import gc
import importlib
import os
import signal
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from forking import forked_nodes
from hypothesis import settings

REPOSITORY = Path(__file__).resolve().parents[1]
CONFIG = REPOSITORY / "config"
MODEL_FILE = CONFIG / "mtmr_28002.yaml"

# Silence after which nodes give up, s: as long as they allow. The arm is a thread of the tests, or
# they themselves: a busy machine stalls it for tenths of a second.
TIMEOUT = 1.0
PATIENT = ("-p", f"timeout:={TIMEOUT}", "-p", "input_depth:=100")
LATE = 1.0  # s that a busy machine may add to a time-out


@cache
def syntax(path: Path) -> tuple[ast.AST, ...]:
    """Return the nodes of a module's syntax tree, itself first."""
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def executables() -> tuple[str, ...]:
    """Return the verbs that setup.py installs."""
    tree = ast.parse((REPOSITORY / "setup.py").read_text())
    return next(
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and node.targets[0].id == "EXECUTABLES"
    )


# `make trials` asks for more.
EXAMPLES = int(os.environ.get("DVRK_GRAVITY_EXAMPLES", "1"))


def examples(count: int) -> int:
    """Return how many examples of a property are tried: ``count``, or a multiple in trials."""
    return count * EXAMPLES


settings.register_profile(
    "repeatable", derandomize=True, deadline=None, database=None, max_examples=examples(50)
)
settings.load_profile("repeatable")


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Collect with compiled modules, and spare the garbage collector all that stays."""
    gc.disable()
    try:
        compile_a_share(session.config)
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def compile_a_share(config: pytest.Config) -> None:
    """Let each worker compile its share of the tests' modules: it loads what others compiled.

    Of a clean checkout pytest compiles for as long as it collects, in each worker all modules.
    What is wrong with a module is reported when it is collected.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is None or config.args_source is not pytest.Config.ArgsSource.TESTPATHS:
        return
    workers = int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
    modules = sorted(path.stem for path in Path(__file__).parent.glob("test_*.py"))
    for name in modules[int(worker.removeprefix("gw")) :: workers]:
        with suppress(Exception):
            importlib.import_module(name)


@pytest.fixture(scope="session")
def measured_data() -> Path:
    """Folder of real measured data; tests that need it are skipped, saying so, without it."""
    folder = Path(os.environ.get("DVRK_GRAVITY_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no measured data in {folder} (DVRK_GRAVITY_DATA names another folder)")
    return folder


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> None:
    """Let processes see Ctrl-C even where a shell runs the tests in the background, ignoring it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def quick_nodes() -> Iterator[None]:
    """Fork nodes from a process that has loaded what they load; let them find each other soon."""
    from dvrk_gravity.ros import ENVIRONMENT

    profile = REPOSITORY / "test" / "discovery.xml"
    with pytest.MonkeyPatch.context() as patch, forked_nodes():
        patch.setitem(ENVIRONMENT, "FASTRTPS_DEFAULT_PROFILES_FILE", str(profile))
        yield


@pytest.fixture(scope="session", autouse=True)
def ambient_domain(quick_nodes: None) -> Iterator[int]:
    """Keep a ROS domain for each worker: no two meet, not even in tests that ask for none."""
    from dvrk_gravity.ros import private_domain

    with private_domain() as number:
        yield number


@contextmanager
def few_folds(count: int = 4) -> Iterator[None]:
    """Hold out four blocks in turn, not twelve: a third of the time where nothing is said of that.

    What identification does is the same; intervals and choices are told by fewer blocks.
    """
    from dvrk_gravity.estimation import FoldSettings, make_folds
    from dvrk_gravity.identification.trajectories import problem
    from dvrk_gravity.intake import coordinates

    few = partial(make_folds, settings=FoldSettings(count=count))
    with pytest.MonkeyPatch.context() as patch:
        for module in (coordinates, problem):
            patch.setattr(module, "make_folds", few)
        yield


@contextmanager
def first_slab() -> Iterator[None]:
    """Hold out poses of one joint, not of each in turn: most of the time of a fit to poses.

    The model, which is of all poses, is the same; its held-out error is told by fewer.
    """
    from dvrk_gravity.identification.poses import fit as static_fit

    slabs_of = static_fit.middle_slabs
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(static_fit, "middle_slabs", lambda poses: slabs_of(poses)[:1])
        yield


@pytest.fixture(scope="module")
def four_folds() -> Iterator[None]:
    """Hold out four blocks in turn in all that a module identifies."""
    with few_folds():
        yield


@pytest.fixture(scope="module")
def brief_simulation() -> Iterator[None]:
    """Simulate for moments what `diagnose` shows of two models, where nothing is said of that."""
    from dvrk_gravity.compensate import simulation_check

    brief = partial(simulation_check.let_go, duration=0.3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation_check, "let_go", brief)
        patch.setattr(simulation_check, "_WINDOWS", 6)
        yield


@pytest.fixture(scope="module")
def blank_pictures() -> Iterator[None]:
    """Write reports whose pictures are not drawn, where nothing is said of them."""
    from matplotlib.figure import Figure

    def save(figure: Figure, stream, **how: object) -> None:
        stream.write(b"\x89PNG")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save)
        yield


@pytest.fixture
def domain() -> Iterator[int]:
    """Return a ROS domain that no other test, demo or benchmark uses at the same time."""
    from dvrk_gravity.ros import private_domain

    with private_domain() as number:
        yield number


@pytest.fixture
def arm(domain: int) -> Iterator[FakeArm]:
    """Return the arm's side of the compensator's topics."""
    with FakeArm() as fake:
        yield fake


def stamp_of(message) -> int:
    """Return a message's stamp in ns."""
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


class FakeArm:
    """Publishes measured_js as a test wants it and collects what comes back."""

    def __init__(self) -> None:
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Bool

        from dvrk_gravity.arms import JOINT_NAMES
        from dvrk_gravity.ros import Client

        self.client = Client()
        self.names = list(JOINT_NAMES)
        self.position = [0.1, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2]
        self.velocity = [0.0] * 7
        self.effort: list[float] = [0.0] * 7
        self.stamp = 0  # of the last message
        self.shift = 0  # of its clock against this computer's, ns
        self.sent = 0
        self.commands: list[tuple[float, JointState]] = []
        self.holds: list[float] = []
        self.switches: list[bool] = []
        node = self.client.node
        self.measured = node.create_publisher(JointState, "measured_js", 100)
        self.builtin = node.create_publisher(JointState, "gravity_compensation/setpoint_js", 100)
        node.create_subscription(
            JointState,
            "servo_jf",
            lambda message: self.commands.append((time.monotonic(), message)),
            1000,
        )
        self.listen_to_hold()
        node.create_subscription(
            Bool,
            "use_gravity_compensation",
            lambda message: self.switches.append(message.data),
            100,
        )
        for name in ("compensator", "watchdog"):
            self.client.watch_state(name)

    def listen_to_hold(self) -> None:
        """Subscribe to ``hold``, as every arm does."""
        from std_msgs.msg import Empty

        self._hold = self.client.node.create_subscription(
            Empty, "hold", lambda _: self.holds.append(time.monotonic()), 100
        )

    def turn_deaf(self) -> None:
        """Listen to ``hold`` no longer."""
        self.client.node.destroy_subscription(self._hold)

    def __enter__(self) -> FakeArm:
        self.client.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.client.__exit__(*error)

    def await_compensator(self, output: str = "servo_jf") -> None:
        """Wait until the node is up and every topic is connected."""
        node = self.client.node
        self.client.wait(
            lambda: (
                bool(self.client.state("compensator"))
                and self.client.connected(self.measured, self.builtin)
                and node.count_publishers(output) > 0
                and node.count_publishers("hold") > 0
            ),
            "the compensator",
        )

    def message(self, **fields: object) -> object:
        """Return a measured_js of now, some of its fields replaced."""
        from sensor_msgs.msg import JointState

        self.stamp = time.time_ns() + self.shift
        values: dict[str, object] = {
            "name": self.names,
            "position": self.position,
            "velocity": self.velocity,
            "effort": self.effort,
            "stamp": self.stamp,
        } | fields
        stamp = values.pop("stamp")
        assert isinstance(stamp, int)
        message = JointState(**values)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        return message

    def send(self, **fields: object) -> None:
        """Publish one measured_js."""
        self.measured.publish(self.message(**fields))
        self.sent += 1

    def run(self, duration: float, rate: float = 200.0, **fields: object) -> None:
        """Publish measured_js for a while."""
        end = time.monotonic() + duration
        while (now := time.monotonic()) < end:
            self.send(**fields)
            self.client.spin(max(0.0, min(1.0 / rate - (time.monotonic() - now), end - now)))

    def run_until(self, condition, what: str, timeout: float = 15.0, **fields: object) -> None:
        """Publish measured_js until a condition holds."""
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f"waited in vain for {what}; state: {self.state}"
            self.run(0.005, **fields)

    def go(self, position) -> None:
        """Publish measured_js on the way to a position, as fast as a joint may move."""
        way = np.array(position) - self.position
        steps = int(np.ceil(np.abs(way).max() / 0.05))
        start = np.array(self.position)
        for part in np.arange(1, steps + 1) / max(steps, 1):
            self.position = (start + part * way).tolist()
            self.run(0.005)

    def answer(self, **fields: object) -> np.ndarray | None:
        """Publish one measured_js; return the effort that answers it, ``None`` if none comes.

        A good message follows it: once that is answered, this one was passed over.
        """
        # A reader may not yet know a writer that knows it: what is sent then is lost.
        self.run_until(lambda: len(self.commands) > 0, "a first command")
        message = self.message(**fields)
        stamp = stamp_of(message)
        self.measured.publish(message)
        self.send()
        self.client.wait(lambda: self.stamp in self.answers, "an answer to a good message", 5.0)
        return self.answers.get(stamp)

    @property
    def answers(self) -> dict[int, np.ndarray]:
        """Efforts received so far, by stamp."""
        return {stamp_of(message): np.array(message.effort) for _, message in self.commands[-50:]}

    @property
    def efforts(self) -> np.ndarray:
        """(N, 7) efforts received so far."""
        return np.array([message.effort for _, message in self.commands])

    @property
    def state(self) -> str:
        """What the compensator last said."""
        return self.client.state("compensator")
