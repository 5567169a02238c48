"""The monitor as a node: what it publishes at once, and what it never does."""

from __future__ import annotations

from monitored import SIMULATOR, monitored
from released import ARM, NAMESPACE
from std_srvs.srv import Trigger

from dvrk_gravity import Recording
from dvrk_gravity.ros import COMMANDS, UNREADABLE, NodeProcess


def test_torques_at_once_a_bag_on_demand_and_never_a_command(domain, tmp_path):
    with (
        monitored(tmp_path) as (heard, monitor),
        NodeProcess("simulator", *SIMULATOR, namespace=NAMESPACE),
    ):
        client = heard.client
        client.wait(lambda: len(heard.torques["external_js"]) >= 50, "a second of torques")
        for name in ("expected_js", "external_js"):
            assert tuple(heard.torques[name][-1].name) == ARM.joint_names
        published = {
            name.rsplit("/", 1)[-1]
            for name, _ in client.node.get_publisher_names_and_types_by_node("monitor", NAMESPACE)
        }
        assert {"expected_js", "external_wrench_std", "events"} <= published
        commands = {name.rsplit("/", 1)[-1] for name, _ in COMMANDS} | {*UNREADABLE}
        assert not published & (commands | {"hold", "servo_jf", "use_gravity_compensation"})
        answer = client.call(Trigger, "monitor/save")
        assert answer.success
        heard.until_saved()
        recording = Recording.load(answer.message.split(";")[0])
        assert recording.joints == ARM.joint_names
        assert len(recording) > 50
        assert monitor.stop() == 0
        assert "Traceback" not in monitor.output
