"""An arm that is released for its time, or whose compensator, watchdog or release is struck."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from released import ARM, MODEL, NAMESPACE, patiently, stalled

from dvrk_gravity.compensate import MotionError
from dvrk_gravity.ros import Client


def test_an_arm_that_its_model_holds_hardly_drifts(rig, tmp_path):
    MODEL.save(tmp_path / "model.yaml")
    with rig.driver() as driver:
        pose = driver.connect()
    drift = patiently(lambda: rig.release(tmp_path / "model.yaml", pose, 1.0))
    assert (drift < np.radians(0.5) * ARM.scale).all()


def child(verb: str) -> int | None:
    """Return the process of a node that this one has started, if there is one."""
    for path in Path("/proc/self/task").glob("*/children"):
        for number in path.read_text().split():
            words = Path(f"/proc/{number}/cmdline").read_bytes().split(b"\0")
            if verb.encode() in words:
                return int(number)
    return None


def test_an_arm_that_nobody_compensates_or_watches_any_more_has_no_drift(rig, tmp_path):
    """A held arm does not drift: that says nothing of its model."""
    model = tmp_path / "model.yaml"
    MODEL.save(model)

    def strike(verb: str, number: signal.Signals, ended: threading.Event) -> None:
        with Client(NAMESPACE, "person") as person:
            person.watch_state("compensator")
            while not ended.is_set():
                person.spin(0.05)
                if person.state("compensator").startswith("commanding"):
                    ended.wait(0.5)  # the release has heard it, too
                    if not ended.is_set():
                        os.kill(child(verb) or os.getpid(), number)
                    return

    def struck(verb: str, number: signal.Signals) -> str:
        """Return how a release ends in which that happens."""
        ended = threading.Event()
        thread = threading.Thread(target=strike, args=(verb, number, ended))
        with rig.driver() as driver:
            pose = driver.connect()  # at rest: it is held
        thread.start()
        with pytest.raises((MotionError, KeyboardInterrupt)) as caught:
            rig.release(model, pose, 60.0)
        ended.set()
        thread.join()
        return repr(caught.value)

    for verb, number, says in (
        ("compensator", signal.SIGSTOP, "hold sent"),  # it does not say so itself
        ("watchdog", signal.SIGKILL, "watchdog has ended"),
        ("calibrate", signal.SIGTSTP, "KeyboardInterrupt"),  # Ctrl-Z
    ):
        found: list[str] = []
        while not found or (says not in found[-1] and stalled(found[-1]) and len(found) < 5):
            found.append(struck(verb, number))
        assert says in found[-1], found
    with rig.driver() as driver:
        driver.connect()
