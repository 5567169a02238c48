"""Quick fits of a UR5, and what their verdicts say of the weight that its file states."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from fitted import FEW, ur5_motion
from robots import UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.identification import Fit, identify
from dvrk_gravity.recording import Recording

LIFT, ELBOW = 1, 2  # of the UR5
BOTH = {"shoulder_lift_joint", "elbow_joint"}
POOR = "do_not_compensate"


def placeholder(folder: Path, mass: float) -> str:
    text = re.sub(r'<mass value="[^"]*"', f'<mass value="{mass}"', Path(UR5).read_text())
    (folder / "robot.urdf").write_text(text)
    return str(folder / "robot.urdf")


def fitted_to(effort=None, recording: Recording | None = None, arm: Arm | str = UR5) -> Fit:
    recording = ur5_motion() if recording is None else recording
    recording = replace(recording, effort=recording.effort if effort is None else effort)
    return identify(recording, arm, effects=FEW, physical=False)


def poor(fit: Fit) -> set[str]:
    return {name for name, verdict in fit.verdict.joints.items() if verdict.level == POOR}


def factor_in(line: str) -> float:
    """Return the factor that a finding states."""
    return float(re.search(r"(-?[\d.]+) times", line)[1])
