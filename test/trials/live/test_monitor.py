"""The monitor as a node, past its first ten seconds: states, wrench, a new start, a save."""

from __future__ import annotations

from pathlib import Path

from monitored import SIMULATOR, monitored
from released import ARM, NAMESPACE
from std_srvs.srv import Trigger

from dvrk_gravity import Recording
from dvrk_gravity.ros import NodeProcess


def test_states_and_wrench_of_an_arm_that_begins_anew_and_the_diagnosis_of_a_bag(domain, tmp_path):
    with monitored(tmp_path) as (heard, monitor):
        client = heard.client
        heard.until("state", "silent")
        with NodeProcess("simulator", *SIMULATOR, namespace=NAMESPACE):
            heard.until("state", "as expected", "held by friction")
            client.wait(lambda: bool(heard.wrenches), "a wrench")
            for name, messages in heard.torques.items():
                assert tuple(messages[-1].name) == ARM.joint_names, name
                assert len(messages[-1].effort) == ARM.n
            assert heard.wrenches[-1].header.frame_id == "link4"
            assert "force" in heard.said["wrench unobservable"]
        heard.until("state", "silent")
        # The arm's publisher begins anew.
        with NodeProcess("simulator", *SIMULATOR, namespace=NAMESPACE):
            heard.until("state", "as expected", "held by friction")
        answer = client.call(Trigger, "monitor/save")
        assert answer.success
        bag, diagnosis = answer.message.split("; its diagnosis, when ready: ")
        assert Path(diagnosis).parent == Path(bag).parent
        heard.until_saved("on its way")
        assert heard.said["saved"].startswith(str(tmp_path))
        recording = Recording.load(bag)
        assert recording.joints == ARM.joint_names
        assert len(recording) > 100
        assert monitor.stop() == 0
        assert "Traceback" not in monitor.output
