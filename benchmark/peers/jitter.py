"""What resampling a real MTM's recording costs, with and without physically consistent links.

    PYTHONPATH=. python benchmark/peers/jitter.py

The recording reads the arm 2.7 ms before or after its stamps. `identify` corrects that by the
velocities; docs/peers.md hands positions at even times to every method, in which it stays. Noise in
the accelerations makes inertia too small (errors in variables; Fuller 1987). Printed are, of models
of the first 60 %, the mean inertia about outer_yaw at the recorded poses, and the error of
outer_yaw on the rest: by the measure of docs/peers.md, and by `evaluate` of the recording as it is.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from cases import data_folder, real
from run import error

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import State
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.recording import Recording

SHARE = 0.6  # of the recording, as in cases.real


def main() -> None:
    """Print the table."""
    arm = Arm.load("mtmr")
    whole = Recording.load(data_folder() / "mtm_dynamic_30s_200hz.csv")
    assert whole.time is not None
    at = int(SHARE * len(whole.time))
    first, rest = (
        replace(whole, time=whole.time[rows], position=whole.position[rows],
                velocity=None if whole.velocity is None else whole.velocity[rows],
                effort=None if whole.effort is None else whole.effort[rows])
        for rows in (slice(0, at), slice(at, None))
    )  # fmt: skip
    poses = arm.joint_position(whole.position)[::20]
    turning = State(poses, np.zeros_like(poses), np.eye(arm.n)[:1].repeat(len(poses), axis=0))
    print("fitted to, links that need be / are bodies: kg·m^2, this page's error, evaluate's")
    with TemporaryDirectory() as folder:
        case = next(
            c for c in real(Path(folder)) if not isinstance(c, str) and c.name == "MTM_real"
        )
        test = np.load(case.case.folder / "test.npz")
        motion = [test[name] for name in ("q", "qd", "qdd")]
        for what, recording, coordinates in (
            ("resampled", case.case.folder / "train.csv", "joint"),
            ("as recorded", first, "actuator"),
        ):
            for physical in (False, True):
                model = identify(recording, arm, coordinates, physical=physical).model
                inertia = model.term("link_inertia").torque(turning)[:, 0].mean()
                here = error(case, model.torque(*motion), case.effort)[0]
                there = evaluate(model, rest, "actuator").joints["outer_yaw"].nrmse
                links = "bodies" if physical else "free"
                print(f"{what:12s} {links:8s} {inertia:.3f}  {here:.3f}  {there:.3f}", flush=True)


if __name__ == "__main__":
    main()
