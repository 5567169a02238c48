"""A client of nodes that run in other processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

import rclpy
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from std_srvs.srv import SetBool

from dvrk_gravity.ros.processes import PRIVATE, ProcessError

_AGAIN = 2.0  # s without a response. Chosen: discovery takes a tenth of that on an idle machine
_LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Client:
    """A node of this process, for publishers and subscriptions (context manager).

    Attributes:
        node: The node.
        states: Texts of each watched node's ``~/state``, by node name.
    """

    def __init__(
        self, namespace: str = PRIVATE, name: str = "client", remap: Mapping[str, str] | None = None
    ) -> None:
        """Start a node, whose topics of some names are others."""
        self.context = Context()
        rclpy.init(args=[], context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node(
            name, namespace=namespace, context=self.context,
            cli_args=[word for pair in (remap or {}).items()
                      for word in ("--ros-args", "-r", ":=".join(pair), "--")],
        )  # fmt: skip
        self.states: dict[str, list[str]] = {}
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def watch_state(self, name: str) -> None:
        """Collect the texts of a node's ``~/state``."""
        texts = self.states.setdefault(name, [])

        def receive(message: String) -> None:
            texts.append(message.data)

        self.node.create_subscription(String, f"{name}/state", receive, _LATCHED)

    def state(self, name: str) -> str:
        """Return the last text of a watched ``~/state``, ``""``: none yet."""
        return self.states[name][-1] if self.states[name] else ""

    def spin_once(self, timeout: float = 0.01) -> None:
        """Run one callback, or wait for one at most ``timeout`` seconds."""
        self._executor.spin_once(timeout_sec=timeout)

    def spin(self, duration: float) -> None:
        """Run callbacks for ``duration`` seconds."""
        end = time.monotonic() + duration
        while (remaining := end - time.monotonic()) > 0.0:
            self.spin_once(min(remaining, 0.01))

    def wait(self, condition: Callable[[], bool], what: str, timeout: float = 20.0) -> None:
        """Run callbacks until a condition holds.

        Raises:
            ProcessError: It does not within ``timeout`` seconds; names ``what``.
        """
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                raise ProcessError(f"timed out after {timeout:g} s waiting for {what}")
            self.spin_once()

    def connected(self, *publishers: Any) -> bool:
        """Return whether each publisher has a subscriber."""
        return all(each.get_subscription_count() > 0 for each in publishers)

    def call(
        self, kind: Any, name: str, request: Any = None, timeout: float = 20.0,
        only_reads: bool = False,
    ) -> Any:  # fmt: skip
        """Call a service and return its answer, for which each step may take ``timeout`` s.

        A service that only reads is called again while no response comes: a server that has not yet
        found this client's reader loses its response.
        """
        client = self.node.create_client(kind, name)
        request = kind.Request() if request is None else request
        try:
            self.wait(client.service_is_ready, f"the service {name}", timeout)
            calls = [client.call_async(request)]
            again = time.monotonic() + _AGAIN

            def answered() -> bool:
                nonlocal again
                if only_reads and time.monotonic() > again:
                    calls.append(client.call_async(request))
                    again += _AGAIN
                return any(call.done() for call in calls)

            self.wait(answered, f"a response of {name}", timeout)
            return next(call.result() for call in calls if call.done())
        finally:
            self.node.destroy_client(client)

    def enable(self, value: bool, node: str = "compensator") -> SetBool.Response:
        """Call ``~/enable`` of a compensator and return its answer."""
        return self.call(SetBool, f"{node}/enable", SetBool.Request(data=value))

    def parameters(self, node: str, timeout: float = 20.0) -> dict[str, Any]:
        """Return the parameters of another node by name; ``None`` where one has no value."""

        def read(kind: Any, service: str, request: Any = None) -> Any:
            return self.call(kind, f"{node}/{service}", request, timeout, only_reads=True)

        def ask(names: Sequence[str]) -> list[Any]:
            answer = read(GetParameters, "get_parameters", GetParameters.Request(names=names))
            return [parameter_value_to_python(value) for value in answer.values]

        names = sorted(read(ListParameters, "list_parameters").result.names)
        values = ask(names)
        if len(values) < len(names):  # as rclpy answers where one has no value
            values = [next(iter(ask([name])), None) for name in names]
        return dict(zip(names, values, strict=True))

    def set_parameters(
        self, values: dict[str, Any], node: str = "compensator", timeout: float = 20.0
    ) -> tuple[bool, str]:
        """Set parameters of another node at once; return whether it accepts, and its words."""
        request = SetParametersAtomically.Request(
            parameters=[
                Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
            ]
        )
        name = f"{node}/set_parameters_atomically"
        result = self.call(SetParametersAtomically, name, request, timeout).result
        return result.successful, result.reason
