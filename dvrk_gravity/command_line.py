"""The command lines of the package: verbs, one-line errors, exit statuses, progress.

Status 0: done. 1: the job ran and its answer is "no" (a replay that does not match, a model unfit
to compensate with). 2: bad input, in one line on standard error. 130: Ctrl-C. 141: the reader of
its output has gone (`… | head`).
"""

from __future__ import annotations

import argparse
import os
import pkgutil
import signal
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from functools import partial
from types import SimpleNamespace
from typing import Any, Self, TextIO, cast

# Matrices are small: threads of one product wait for each other for longer than they work, the more
# so on a busy machine. NumPy reads this when it is loaded, which every import below does.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from dvrk_gravity import __version__
from dvrk_gravity.errors import DvrkGravityError, EffectError, printable

# Verb -> (module, or module:class; one line for the overview). Either has NAME, EXAMPLE,
# add_arguments(parser) and run(arguments) -> int; its docstring begins with a description. It is
# imported only when its verb is called: rclpy, Pinocchio and matplotlib are slow to load.
VERBS: dict[str, tuple[str, str]] = {
    "compensator": ("dvrk_gravity.ros.verbs:CompensatorVerb", "node: make an arm weightless"),
    "simulator": ("dvrk_gravity.ros.verbs:SimulatorVerb", "node: a simulated arm"),
    "watchdog": ("dvrk_gravity.ros.verbs:WatchdogVerb", "node: hold the arm when commands stop"),
    "monitor": ("dvrk_gravity.cli.monitor", "what pushes an arm, what changed: node, or a file"),
    "get": ("dvrk_gravity.cli.node_parameters:Get", "parameters of a running node"),
    "set": ("dvrk_gravity.cli.node_parameters:Set", "change a parameter of a running node"),
    "convert": ("dvrk_gravity.cli.convert", "console JSON <-> model, CSV <-> rosbag2"),
    "plan": ("dvrk_gravity.cli.plan", "the motion that would teach most, within limits"),
    "collect": ("dvrk_gravity.cli.collect", "move an arm along a plan, and record it"),
    "excite": ("dvrk_gravity.cli.excite", "move an arm for identification, and record it"),
    "replay": ("dvrk_gravity.cli.replay", "play a bag into the real node, and check its answers"),
    "identify": ("dvrk_gravity.cli.identify", "recordings -> torque model"),
    "evaluate": ("dvrk_gravity.cli.evaluate", "error of a model on recordings"),
    "diagnose": ("dvrk_gravity.cli.diagnose", "what a model gets wrong, with evidence"),
    "calibrate": ("dvrk_gravity.cli.calibrate", "from an arm to a certified model"),
    "fleet": ("dvrk_gravity.cli.fleet", "many arms' recordings -> results, on Dask"),
    "history": ("dvrk_gravity.cli.history", "what changed in which arm, since when"),
    "demo": ("dvrk_gravity.cli.demo", "everything in simulation: fall, float, push, kill"),
    "newton-euler": (
        "dvrk_gravity.cli.newton_euler",
        "torques and joint reactions of a serial chain",
    ),
}

VERSION = f"dvrk_gravity {__version__}"

_INTERRUPTED = 128 + signal.SIGINT


CLEAR_LINE = "\r\033[K"  # of a terminal


class PrintableStream:
    """A stream of text that shows what its terminal would obey; see :func:`printable`.

    Attributes:
        unchecked: The stream that it writes to.
    """

    def __init__(self, stream: TextIO) -> None:
        """Write to a stream."""
        self.unchecked = stream

    def write(self, text: str) -> int:
        """Write a text; ends of lines stay, and a line that begins by clearing itself."""
        clear = CLEAR_LINE if text.startswith(CLEAR_LINE) else ""
        lines = text[len(clear) :].split("\n")
        return self.unchecked.write(clear + "\n".join(map(printable, lines)))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.unchecked, name)


def run(name: str, argv: Sequence[str] | None = None) -> int:
    """Run a module or class of :data:`VERBS` and return the exit status.

    What it prints is printable.

    Args:
        name: ``package.module`` or ``package.module:Class``.
        argv: Arguments after the verb; ``None`` means ``sys.argv[1:]``.
    """
    with ExitStack() as stack:
        if sys.stdout is not None:  # it is closed
            stack.enter_context(redirect_stdout(cast(TextIO, PrintableStream(sys.stdout))))
        if sys.stderr is not None:
            stack.enter_context(redirect_stderr(cast(TextIO, PrintableStream(sys.stderr))))
        return _run(name, argv)


def _run(name: str, argv: Sequence[str] | None) -> int:
    # A node handles signals once there is something to leave in order (ros/runtime.py). Before that
    # Ctrl-C just ends it: an exception would come out of some half-done import.
    is_node = name.startswith(f"{__package__}.ros.")
    signal.signal(signal.SIGINT, signal.SIG_DFL if is_node else signal.default_int_handler)
    verb = pkgutil.resolve_name(name)
    parser = argparse.ArgumentParser(
        prog=f"dvrk_gravity {verb.NAME}",
        description=(verb.__doc__ or "").splitlines()[0],
        epilog=f"example: {verb.EXAMPLE}",
        formatter_class=argparse.RawDescriptionHelpFormatter,  # an example a line
    )
    parser.add_argument("--version", action="version", version=VERSION)
    verb.add_arguments(parser)
    # rclpy gets everything from --ros-args on, where `ros2 run` puts its own.
    words = list(sys.argv[1:] if argv is None else argv)
    split = words.index("--ros-args") if "--ros-args" in words else len(words)
    arguments = parser.parse_args(words[:split])
    arguments.ros_args = words[split:]
    try:
        status: int = verb.run(arguments)
        sys.stdout.flush()  # here, and not at exit, where a closed pipe is a traceback
        return status
    except BrokenPipeError:
        # The rest of the buffer would be written at exit, and fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except (DvrkGravityError, OSError) as error:
        print(f"dvrk_gravity {verb.NAME}: {one_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return _INTERRUPTED
    except ModuleNotFoundError as error:
        module = (error.name or "").split(".")[0]
        if module in ("", __package__):
            raise
        print(f"dvrk_gravity {verb.NAME}: {_how_to_get(module)}", file=sys.stderr)
        return 2
    except Exception as error:
        ended = _status_of_signal(error)
        if ended is not None:
            return ended
        slip = _slip_of_an_effect(error)
        if slip is None:
            raise
        print(f"dvrk_gravity {verb.NAME}: {slip}", file=sys.stderr)
        return 2


# Entry points of ``ros2 run dvrk_gravity VERB``, with _ for -: an executable that was renamed, or
# that a link of another name leads to, still runs its verb.
executables = SimpleNamespace(
    **{verb.replace("-", "_"): partial(run, name) for verb, (name, _) in VERBS.items()}
)


def _how_to_get(module: str) -> str:
    """Return what a verb needs that is not installed, and how to get it."""
    if module.startswith(("rcl", "rosgraph", "std_")) or module.endswith("_msgs"):
        return (
            f"needs ROS 2 (no module {module}): source its setup.bash, or "
            '`pip install "dvrk_gravity[ros]"`'
        )
    package = {"pinocchio": "pin", "yaml": "pyyaml"}.get(module, module)
    return (
        f"needs the Python module {module}, which is not installed: `pip install {package}`, with "
        f"ROS's Python `pip install --break-system-packages {package}`"
    )


def by_signal(error: BaseException) -> bool:
    """Return whether Ctrl-C, or what ends a process as it does, caused an error."""
    ended = isinstance(error, KeyboardInterrupt | SystemExit)
    return ended or _status_of_signal(error) is not None


def _status_of_signal(error: BaseException) -> int | None:
    """Return the exit status if a signal caused an error of compiled code, else ``None``."""
    cause = error.__cause__  # Ctrl-C, or SystemExit of ros.processes.end_on_signals
    if isinstance(cause, KeyboardInterrupt):
        return _INTERRUPTED
    if isinstance(cause, SystemExit) and isinstance(cause.code, int):
        return cause.code
    return None if cause is None else _status_of_signal(cause)


def _slip_of_an_effect(error: Exception) -> EffectError | None:
    """Return an error that arose in the code of an effect of another package, by its name."""
    from dvrk_gravity.effects import from_other_packages

    named = from_other_packages()
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        effect = named.get(frame.f_globals.get("__name__", ""))
        if effect is not None:
            where = f"{frame.f_code.co_filename}, line {line}, in {frame.f_code.co_name}"
            return EffectError(effect, f"{type(error).__name__}: {error} ({where})")
    return None


def one_line(error: Exception) -> str:
    """Return an error's text on one line, with the file first for an ``OSError``."""
    if isinstance(error, OSError) and error.filename is not None:
        return printable(f"{error.filename}: {error.strerror or error}")
    return printable(" ".join(str(error).split()))


class Progress:
    """Progress and remaining time: a line that counts on a terminal (context manager).

    Where standard error is no terminal, a log for instance, it is a line every ten seconds. It
    never decreases. The remaining time is extrapolated from the elapsed time.
    """

    EVERY = 10.0  # s between lines where standard error is no terminal
    AGAIN = 0.2  # least time between updates of a terminal's line, s
    LEAST = 2.0  # s before a remaining time is shown: the pace is unknown. Chosen.

    def __init__(self, what: str, total: float) -> None:
        self._what, self._total = what, total
        self._begun = self._said = time.monotonic()
        self._share = 0.0
        self._shown = ""

    def update(self, done: float) -> None:
        """Count up to ``done``, and show it from time to time."""
        self._share = max(self._share, min(done / max(self._total, 1), 1.0))
        now, terminal = time.monotonic(), sys.stderr.isatty()
        line = f"{self._what}: {100 * self._share:.0f} %{self._left(now - self._begun)}"
        due = self.AGAIN if terminal and self._shown else 0.0 if terminal else self.EVERY
        if line == self._shown or now - self._said < due:
            return
        before, after = (CLEAR_LINE, "") if terminal else ("", "\n")
        print(f"{before}{line}", end=after, file=sys.stderr, flush=True)
        self._shown, self._said = line, now

    def done(self) -> None:
        """Clear the line."""
        if self._shown and sys.stderr.isatty():
            print(CLEAR_LINE, end="", file=sys.stderr, flush=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.done()

    def _left(self, passed: float) -> str:
        if not 0.0 < self._share < 1.0 or passed < self.LEAST:
            return ""
        left = passed * (1.0 - self._share) / self._share
        if left < 90.0:
            step = 1.0 if left < 10.0 else 5.0
            return f", about {max(step * round(left / step), 1.0):.0f} s left"
        return f", about {left / 60.0:.0f} min left"


class Stages:
    """Progress by stages, each of which begins at a known share of the whole."""

    # Part of the rest of a stage that a step counts for, where no share is known. Chosen: a search
    # took 3 steps or 65, and with this the remaining time is right halfway through the 65.
    CREEP = 0.02

    def __init__(self, progress: Progress, begins: Sequence[tuple[str, float]]) -> None:
        """List the stages in their order; one may recur, and any may be skipped.

        Args:
            progress: Shows it; its total is 1.
            begins: Name of each stage, and the share of the whole at its beginning.
        """
        self._progress = progress
        self._names = [name for name, _ in begins]
        self._begins = [*(share for _, share in begins), 1.0]
        self._at, self._within = 0, 0.0

    def __call__(self, stage: str, share: float | None = None) -> None:
        """Count the beginning of a stage, or a step of the present one.

        Args:
            stage: Its name; any other text is a step of the present stage.
            share: Completed part of the stage, if known.
        """
        if share is None and stage not in self._names[self._at :]:
            self._within += self.CREEP * (1.0 - self._within)
        else:
            known = self._names[self._at :]
            ahead = known.index(stage) if stage in known else 0
            self._at, self._within = self._at + ahead, share or 0.0
        begin, end = self._begins[self._at : self._at + 2]
        self._progress.update(begin + self._within * (end - begin))


class ProgressBySteps:
    """Progress of one step after the other, each on a line of its own."""

    def __init__(self, stages: Mapping[str, Sequence[tuple[str, float]]] | None = None) -> None:
        """Show nothing yet.

        Args:
            stages: Stages of steps by the first word of their name; see :class:`Stages`.
        """
        self._of_stages, self._step = stages or {}, ""
        self._progress: Progress | None = None

    def __call__(self, step: str, part: float | None, stage: str = "") -> None:
        """Show a step's completed part, 0 to 1, or that of a stage of it."""
        if step != self._step or self._progress is None:
            self.done()
            self._step, self._progress = step, Progress(step, 1.0)
            self._stages = Stages(self._progress, self._of_stages.get(step.split()[0], ()))
        if stage:
            self._stages(stage, part)
        else:
            self._progress.update(part or 0.0)

    def done(self) -> None:
        """Clear the line."""
        if self._progress is not None:
            self._progress.done()
