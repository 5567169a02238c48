"""How every node of the package starts, spins, and ends: signals, errors, exit status."""

from __future__ import annotations

import gc
import math
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.model import BY_EFFECTS, UNCERTAINTY_PARAMETER, TorqueModel, resolve_arm_path
from dvrk_gravity.parameters import Parameter, check_all
from dvrk_gravity.ros.executor import PromptExecutor, PromptNode, keep_awake
from dvrk_gravity.validation import refuse_json

_STEADY_CLOCK = Clock(clock_type=ClockType.STEADY_TIME)

OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""Beginnings of the parameters that rclpy itself declares on every node."""

_LOOK = 0.05  # s

_folders: list[Path] = []  # of the parameter files of this process

_NOT_OURS = {
    signal.SIGKILL, signal.SIGSTOP,  # cannot be caught
    signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT, signal.SIGTRAP,
    signal.SIGSYS,  # faults of the process itself
    signal.SIGPIPE, signal.SIGXFSZ,  # which Python turns into an error of the call
    signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH,  # end nothing
    signal.SIGTTIN, signal.SIGTTOU,  # of a process in the background
}  # fmt: skip

SIGNALS = tuple(sorted(signal.valid_signals() - _NOT_OURS))
"""Those that end a process, or suspend it (Ctrl-Z), unless handled (signal(7)): a process that
sleeps must not leave an arm."""


@contextmanager
def catch_end_signals(ask: Callable[[], None]) -> Iterator[None]:
    """Call ``ask`` for each signal that would end the process: it holds the arm first.

    A signal may interrupt it while it is called for another one: it must take no lock.
    """
    before = {number: signal.signal(number, lambda *_: ask()) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def spin(make_node: Callable[[], Node], ros_args: Sequence[str]) -> int:
    """Run one node until a signal or an error ends it.

    Args:
        make_node: Builds the node, after rclpy is up; the node has ``finish()``, which returns
            whether it ended in order.
        ros_args: ``--ros-args …`` of the command line.

    Returns:
        0 after a signal, 1 after an unexpected error, or if it could not end in order (a hold that
        was not acknowledged).

    Raises:
        ConfigError: ROS arguments or parameters that cannot be used.
    """
    files = [path for flag, path in pairwise(ros_args) if flag == "--params-file"]
    _folders[:] = [Path(path).absolute().parent for path in files]
    for path in files:
        refuse_json("--params-file", path)
        yaml_file.load(path)  # rcl's message for a bad file is long and names no cause
    asked: list[bool] = []
    with catch_end_signals(lambda: asked.append(True)):
        return _run(make_node, ros_args, files, asked)


def _run(
    make_node: Callable[[], Node], ros_args: Sequence[str], files: list[str], asked: Sequence[bool]
) -> int:
    try:
        rclpy.init(args=list(ros_args), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rcl reports bad arguments and files as several types
        raise ConfigError("--ros-args", _first_line(error), "valid ROS arguments") from error
    try:
        try:
            node = _construct(make_node)
        except ConfigError as error:
            on_command_line = any(word.startswith(f"{error.field}:=") for word in ros_args)
            if len(files) != 1 or error.source or on_command_line:
                raise
            raise error.in_file(files[0]) from None
        try:
            status = _spin(node, asked)
        finally:
            well = node.finish()  # type: ignore[attr-defined]
            node.destroy_node()
        return status if well else max(status, 1)
    finally:
        rclpy.try_shutdown()


def every(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Call back every so many seconds, whatever a simulated or stepped clock says.

    No such clock must stop a watch on the input.
    """
    return node.create_timer(period, callback, clock=_STEADY_CLOCK)


def given_parameters(node: Node) -> dict[str, Any]:
    """Return the parameters of files and arguments, by dotted name.

    An arm's file is also searched for beside the parameter files. The node is built with
    ``automatically_declare_parameters_from_overrides``.
    """
    values = {
        name: plain_value(node.get_parameter(name).value)
        for name in node.get_parameters_by_prefix("")
        if not name.startswith(OF_RCLPY)
    }
    for folder in _folders:
        values = resolve_arm_path(values, folder)
    return values


def model_of(values: Mapping[str, Any]) -> TorqueModel:
    """Return the model of given parameters, with the uncertainty beside its parameter file.

    Raises:
        ConfigError: Parameters that make no model, or another model's uncertainty.
    """
    name = Path(str(values.get(UNCERTAINTY_PARAMETER.name, ""))).name
    folders = [folder for folder in _folders if (folder / name).exists()]
    return TorqueModel.from_values(values, (folders or _folders or [Path()])[0])


def plain_value(value: Any) -> Any:
    """Return a parameter's value with ROS's arrays as tuples."""
    if isinstance(value, bool | int | float | str | bytes) or value is None:
        return value
    return tuple(value)


def declare(node: Node, table: Mapping[str, Parameter], values: Mapping[str, Any]) -> None:
    """Declare parameters in force with dynamic types, so that only our own check refuses a change.

    rclpy would fix the type that a file happened to have (whole numbers, say).
    """
    for name, value in values.items():
        if node.has_parameter(name):
            node.undeclare_parameter(name)
        plain_value = list(value) if isinstance(value, tuple) else value
        node.declare_parameter(name, plain_value, _descriptor(table[name]), ignore_override=True)


def declare_constants(
    node: Node, table: Mapping[str, Parameter], given: Mapping[str, Any], others: Iterable[str] = ()
) -> dict[str, Any]:
    """Declare parameters that a node reads at its start alone; return all of a table's values.

    Args:
        node: The node.
        table: Its parameters.
        given: Values of some of them.
        others: Names of parameters that are already declared, and cannot be changed either.

    Raises:
        ConfigError: An unknown name, or a value that fails its check.
    """
    values: dict[str, Any] = {name: entry.default for name, entry in table.items()}
    values |= check_all(table, given, BY_EFFECTS)
    declare(node, table, values)
    constants = {*table, *others}

    def refuse(changes: list[Any]) -> SetParametersResult:
        for change in changes:
            if change.name in constants:
                reason = f"{change.name} is read only at the start"
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(refuse)
    return values


def _descriptor(entry: Parameter) -> ParameterDescriptor:
    """Return the output of `ros2 param describe`."""
    unit = f", {entry.unit_text}" if entry.unit_text else ""
    descriptor = ParameterDescriptor(
        name=entry.name,
        description=f"{entry.meaning} ({entry.kind}{unit})",
        additional_constraints=entry.range_text(),
        read_only=entry.read_only,
        dynamic_typing=True,
    )
    # The middleware checks finite ranges of scalars only.
    if entry.kind == "double" and math.isfinite(entry.lower) and math.isfinite(entry.upper):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=entry.lower, to_value=entry.upper, step=0.0)
        ]
    return descriptor


def _construct(make_node: Callable[[], Node]) -> Node:
    try:
        return make_node()
    except ValueError as error:
        if "PARAMETER_NOT_SET" in str(error):
            raise ConfigError(
                "--params-file", "an empty list", "a list of numbers, or no such line"
            ) from error
        raise


def _spin(node: Node, asked: Sequence[bool]) -> int:
    gc.collect()
    gc.freeze()  # objects so far stay: no collection has to check them again
    executor = _executor_of(node)
    try:
        with keep_awake(executor):
            while not asked:
                executor.spin_once(timeout_sec=0.1)
    except MemoryError:
        node.get_logger().fatal("out of memory: the arm is held, and this node ends")
        return 1
    except Exception:  # in any case the arm is held, and the cause reported
        node.get_logger().fatal(f"unexpected error: {_first_line(sys.exc_info()[1])}")
        traceback.print_exc()
        return 1
    finally:
        executor.shutdown()
    return 0


def _executor_of(node: Node) -> SingleThreadedExecutor:
    if isinstance(node, PromptNode):
        return PromptExecutor(node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    return executor


def outlive(node: Node, others: Callable[[], bool], longest: float) -> None:
    """Serve a node that was asked to end while others need it, at most ``longest`` seconds.

    Ctrl-C at a terminal, or of a launch file, reaches every process at once, in any order.
    """
    executor = _executor_of(node)
    end = time.monotonic() + longest
    while others() and (now := time.monotonic()) < end:
        while (left := now + _LOOK - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=left)
    executor.shutdown()


def _first_line(error: object) -> str:
    """Return an error's text without the source locations that rcl appends."""
    text = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    return text.split(", at ./src")[0].split(", at /")[0]
