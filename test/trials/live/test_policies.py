"""The access policies allow exactly what the nodes do."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from arm_side import PATIENT
from std_msgs.msg import Float64MultiArray
from support import CONFIG, MODEL_FILE

from dvrk_gravity.ros import PRIVATE, UNREADABLE, Client, NodeProcess, OperatingState

ACCESS = {"topics": ("publish", "subscribe"), "services": ("reply", "request")}
NODES = {
    "compensator": ("--params-file", str(MODEL_FILE), *PATIENT),
    "watchdog": ("-p", "watchdog_timeout:=1.0"),
    "simulator": ("-p", "builtin_gravity_compensation:=false"),
}
POLICIES = {"servo_jf": ("mtml", "/MTML"), "array": ("effort_controller", "/ARM")}
# Whose types come with the dVRK's workspace: not subscribed to without it.
OF_THE_WORKSPACE = {*UNREADABLE, *(() if OperatingState else ("operating_state",))}


def allowed(policy: str, node: str) -> dict[str, set[str]]:
    """What a policy lets a node do: full names, by kind of access."""
    profiles = ElementTree.fromstring(policy).iter("profile")
    (profile,) = (item for item in profiles if item.get("node") == node)
    namespace = profile.get("ns")
    names: dict[str, set[str]] = {}
    for group in profile:
        (access,) = (kind for kind in ACCESS[group.tag] if group.get(kind) == "ALLOW")
        for item in group:
            text = (item.text or "").strip()
            if text in OF_THE_WORKSPACE:
                continue
            full = text if text.startswith("/") else f"{namespace}/{text}"
            names.setdefault(access, set()).add(full.replace("/~/", f"/{node}/"))
    return names


def test_the_policies_allow_exactly_what_the_nodes_do(arm):
    with Client(name="effort_controller") as controller:
        controller.node.declare_parameter("joints", arm.names)
        controller.node.create_subscription(Float64MultiArray, "commands", lambda _: None, 1)
        for output in POLICIES:
            arm.client.states["compensator"].clear()
            compare(arm, controller, output)


def compare(arm, controller, output: str) -> None:
    """Start the nodes, and compare; a policy for another namespace is made as documented."""
    name, namespace = POLICIES[output]
    text = (CONFIG / "security" / f"{name}.policy.xml").read_text(encoding="utf-8")
    # A simulated arm beside the one of this test would be a second one at its topics.
    places = {verb: f"{PRIVATE}/sim" if verb == "simulator" else PRIVATE for verb in NODES}
    granted = {verb: allowed(text.replace(namespace, places[verb]), verb) for verb in NODES}
    used: dict[str, dict[str, set[str]]] = {verb: {} for verb in NODES}
    node = arm.client.node

    def complete() -> bool:
        """Whether all that the policy allows is there; what is there beyond it is judged below."""
        there = {*node.get_node_names_and_namespaces()}
        for access, ask in (
            ("publish", node.get_publisher_names_and_types_by_node),
            ("subscribe", node.get_subscriber_names_and_types_by_node),
            ("reply", node.get_service_names_and_types_by_node),
            ("request", node.get_client_names_and_types_by_node),
        ):
            # Gathered over time: the compensator listens to its own topic only until it commands.
            for verb, place in places.items() & there:
                names = {each for each, _ in ask(verb, place)}
                used[verb][access] = used[verb].get(access, set()) | names
        return all(
            names <= used[verb].get(access, set())
            for verb in NODES
            for access, names in granted[verb].items()
        )

    started = [
        NodeProcess(verb, *NODES[verb], "-p", f"output:={output}", namespace=places[verb])
        for verb in NODES
    ]
    try:

        def commands() -> bool:
            complete()
            seen, meant = (each["compensator"].get("request", set()) for each in (used, granted))
            if meant <= seen:  # the controller answers once it was seen that it is asked
                controller.spin_once(0.0)
            return arm.state.startswith(("ramping", "commanding"))

        arm.run_until(commands, "commands", 30.0)
        arm.client.enable(False)
        arm.run_until(complete, "all that the policy allows")
    finally:
        for process in started:
            process.stop()
    for verb in NODES:
        found = {access: names for access, names in used[verb].items() if names}
        assert found == granted[verb], verb
