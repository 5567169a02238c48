"""The monitor as a node: what it publishes at once, and what it never does."""

from __future__ import annotations

from monitored import SIMULATOR, Listening
from released import ARM, MODEL, NAMESPACE
from std_srvs.srv import Trigger

from dvrk_gravity import Recording
from dvrk_gravity.ros import COMMANDS, UNHEARD, Client, NodeProcess


def test_torques_at_once_a_bag_on_demand_and_never_a_command(domain, tmp_path):
    MODEL.save(tmp_path / "model.yaml")
    words = ("--params-file", f"{tmp_path / 'model.yaml'}", "-p", f"save_folder:={tmp_path}")
    with (
        Client(NAMESPACE) as client,
        NodeProcess("monitor", *words, namespace=NAMESPACE) as monitor,
        NodeProcess("simulator", *SIMULATOR, namespace=NAMESPACE),
    ):
        heard = Listening(client)
        client.wait(lambda: len(heard.torques["external_js"]) >= 50, "a second of torques")
        for name in ("expected_js", "external_js"):
            assert tuple(heard.torques[name][-1].name) == ARM.joint_names
        published = {
            name.rsplit("/", 1)[-1]
            for name, _ in client.node.get_publisher_names_and_types_by_node("monitor", NAMESPACE)
        }
        assert {"expected_js", "external_wrench_std", "events"} <= published
        commands = {name.rsplit("/", 1)[-1] for name, _ in COMMANDS} | {*UNHEARD}
        assert not published & (commands | {"hold", "servo_jf", "use_gravity_compensation"})
        answer = client.call(Trigger, "monitor/save")
        assert answer.success
        heard.wait_for_bag()
        recording = Recording.load(answer.message.split(";")[0])
        assert recording.joints == ARM.joint_names
        assert len(recording) > 50
        assert monitor.stop() == 0
        assert "Traceback" not in monitor.output
