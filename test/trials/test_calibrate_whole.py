"""A whole calibration of a simulated arm, further motions included, in one go and interrupted."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from finished_calibration import BRIEF, KilledError, work_in
from support import REPOSITORY

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import SimulatedRig, calibrate, draw_arm
from dvrk_gravity.simulate import PlantFile


def test_interrupted_or_not_what_is_found_is_the_same_to_the_last_bit(tmp_path):
    arm = Arm.load("ecm")
    settings = replace(BRIEF, poses=20)  # of which one is not sure to be held: it moves further
    folders = [tmp_path / name for name in ("once", "killed")]
    for folder in folders:
        folder.mkdir()

        def report(line: str, folder=folder) -> None:
            if folder is folders[1] and not line.endswith("(done before)"):
                raise KilledError

        for _ in range(20):
            rig = SimulatedRig(draw_arm(PlantFile.of(arm), 1), 1, settings.friction)
            try:
                calibrate(work_in(folder, arm, report, rig=rig, settings=settings))
            except KilledError:
                continue
            break
    names = ("*.yaml", "model*.npz", "model_*.json", "check.json", "release.json")
    once = sorted(path for name in names for path in folders[0].glob(name))
    assert "model_1.yaml" in {path.name for path in once}
    for path in once:
        assert path.read_bytes() == (folders[1] / path.name).read_bytes(), path.name


def test_a_process_that_is_killed_in_its_motion_goes_on_there(tmp_path):
    out = tmp_path / "out"
    words = [
        sys.executable, "-m", "dvrk_gravity", "calibrate", "--arm", "ecm", "--simulated",
        "--out", str(out), "--no-rehearsal", "--time", "1", "--duration", "20",
    ]  # fmt: skip

    def run_until(there) -> str:
        process = subprocess.Popen(
            words, cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        while not there() and process.poll() is None:
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        return process.communicate()[0]

    state, book = out / "motion.unfinished" / "state.json", out / "calibration.json"

    def moving() -> bool:
        return state.exists() and json.loads(state.read_text())["moment"] > 1.0

    def noted() -> bool:
        return book.exists() and "collect motion" in book.read_text()

    assert "plan motion" in run_until(moving)
    if noted():
        pytest.skip("this machine killed it after its motion")
    assert "(done before)" in run_until(noted)
    assert (out / "motion").exists()
    assert not state.exists()
