"""What every command line of the package shares: one-line errors and exit statuses.

Status 0: done. 1: the job ran and its answer is "no" (a replay that does not
match, a model that is not to be compensated with). 2: bad input, told in one line
on standard error. 130: Ctrl-C. 141: nobody reads its output any more (`… | head`).
"""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from typing import Self

# Matrices here are small: threads of one product wait for each other for longer than they work, the
# more so on a busy machine. NumPy reads it when it is loaded, which every import below does.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from dvrk_gravity import __version__
from dvrk_gravity.errors import DvrkGravityError, EffectError

# Verb -> (module, one line for the overview). A module is imported only when
# its verb is called: rclpy, Pinocchio and matplotlib are slow to load.
VERBS: dict[str, tuple[str, str]] = {
    "compensator": ("dvrk_gravity.ros.compensator", "node: make an arm weightless"),
    "simulator": ("dvrk_gravity.ros.simulator", "node: an arm as seen from ROS"),
    "watchdog": ("dvrk_gravity.ros.watchdog", "node: hold the arm when commands stop"),
    "convert": ("dvrk_gravity.cli.convert", "console JSON <-> model, CSV <-> rosbag2"),
    "excite": ("dvrk_gravity.cli.excite", "drive an arm to be identified, and record it"),
    "replay": ("dvrk_gravity.cli.replay", "a bag through the real node, checked"),
    "identify": ("dvrk_gravity.cli.identify", "recordings -> torque model"),
    "evaluate": ("dvrk_gravity.cli.evaluate", "error of a model on recordings"),
    "diagnose": ("dvrk_gravity.cli.diagnose", "what a model gets wrong, and the proof"),
    "demo": ("dvrk_gravity.cli.demo", "fall, float, push, kill: the whole in simulation"),
    "newton-euler": (
        "dvrk_gravity.cli.newton_euler",
        "torques and joint reactions of a serial chain",
    ),
}

VERSION = f"dvrk_gravity {__version__}"

_INTERRUPTED = 128 + signal.SIGINT


def run(module_name: str, argv: Sequence[str] | None = None) -> int:
    """Run one verb: parse ``argv`` and call the module's ``run``.

    Args:
        module_name: Module with ``NAME``, ``EXAMPLE``, ``add_arguments(parser)``
            and ``run(arguments) -> int``; its docstring's first line describes it.
        argv: Arguments after the verb; ``None`` means ``sys.argv[1:]``.

    Returns:
        The exit status (see the module docstring).
    """
    # A node takes signals in hand when there is something to leave in order (ros/runtime.py).
    # Before that Ctrl-C just ends it: an exception would come out of some half-done import.
    is_node = module_name.startswith(f"{__package__}.ros.")
    signal.signal(signal.SIGINT, signal.SIG_DFL if is_node else signal.default_int_handler)
    module = importlib.import_module(module_name)
    parser = argparse.ArgumentParser(
        prog=f"dvrk_gravity {module.NAME}",
        description=(module.__doc__ or "").splitlines()[0],
        epilog=f"example: {module.EXAMPLE}",
        formatter_class=argparse.RawDescriptionHelpFormatter,  # an example a line
    )
    parser.add_argument("--version", action="version", version=VERSION)
    module.add_arguments(parser)
    # Everything from --ros-args on is for rclpy, as `ros2 run` hands it over.
    words = list(sys.argv[1:] if argv is None else argv)
    split = words.index("--ros-args") if "--ros-args" in words else len(words)
    arguments = parser.parse_args(words[:split])
    arguments.ros_args = words[split:]
    try:
        status: int = module.run(arguments)
        sys.stdout.flush()  # here, and not at exit, where a closed pipe is a traceback
        return status
    except BrokenPipeError:
        # What is left in the buffer would be written at exit, and fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except (DvrkGravityError, OSError) as error:
        print(f"dvrk_gravity {module.NAME}: {one_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return _INTERRUPTED
    except Exception as error:
        ended = _status_of_signal(error)
        if ended is not None:
            return ended
        slip = _slip_of_an_effect(error)
        if slip is None:
            raise
        print(f"dvrk_gravity {module.NAME}: {slip}", file=sys.stderr)
        return 2


def _status_of_signal(error: BaseException) -> int | None:
    """Return the exit status if an error is what compiled code made of a signal, its cause then.

    Ctrl-C is a ``KeyboardInterrupt``; :func:`dvrk_gravity.ros.processes.end_on_signals` raises
    ``SystemExit``.
    """
    cause = error.__cause__
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
        return f"{error.filename}: {error.strerror or error}"
    return " ".join(str(error).split())


class Progress:
    """How much is done and how long the rest takes: a line that counts on a terminal.

    Where standard error is no terminal, a log for instance, a line every ten seconds. It never goes
    back. The time left is what has passed, times what is left over what is done.
    """

    EVERY = 10.0
    """s between lines where standard error is no terminal."""

    AGAIN = 0.2
    """s between renewals of the line of a terminal, at least."""

    LEAST = 2.0
    """s before any time left is shown: nothing is known of the pace. Chosen."""

    def __init__(self, what: str, total: float) -> None:
        """Count up to ``total``."""
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
        before, after = ("\r\033[K", "") if terminal else ("", "\n")
        print(f"{before}{line}", end=after, file=sys.stderr, flush=True)
        self._shown, self._said = line, now

    def done(self) -> None:
        """Clear the line."""
        if self._shown and sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)

    def __enter__(self) -> Self:
        """Begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """Clear the line, whatever happened."""
        self.done()

    def _left(self, passed: float) -> str:
        """Return the time left in words, as exactly as it is known."""
        if not 0.0 < self._share < 1.0 or passed < self.LEAST:
            return ""
        left = passed * (1.0 - self._share) / self._share
        if left < 90.0:
            step = 1.0 if left < 10.0 else 5.0
            return f", about {max(step * round(left / step), 1.0):.0f} s left"
        return f", about {left / 60.0:.0f} min left"


class Stages:
    """A progress by stages, of which each is known to begin at some share of the whole."""

    CREEP = 0.02
    """Part of the rest of a stage that one step of it counts for, where no share is known.

    Chosen: a search took 3 steps or 65, and by this the time left is right halfway through the 65.
    """

    def __init__(self, progress: Progress, begins: Sequence[tuple[str, float]]) -> None:
        """Take the stages in their order; one may come again, and any may be left out.

        Args:
            progress: Shows it; its total is 1.
            begins: Name of each stage, and the share of the whole that is done when it begins.
        """
        self._progress = progress
        self._names = [name for name, _ in begins]
        self._begins = [*(share for _, share in begins), 1.0]
        self._at, self._within = 0, 0.0

    def __call__(self, stage: str, share: float | None = None) -> None:
        """Count a stage that begins, or a step of the one that runs.

        Args:
            stage: Its name; another text is a step of the stage that runs.
            share: Part of the stage that is done, if it is known.
        """
        if share is None and stage not in self._names[self._at :]:
            self._within += self.CREEP * (1.0 - self._within)
        else:
            known = self._names[self._at :]
            ahead = known.index(stage) if stage in known else 0
            self._at, self._within = self._at + ahead, share or 0.0
        begin, end = self._begins[self._at : self._at + 2]
        self._progress.update(begin + self._within * (end - begin))
