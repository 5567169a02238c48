"""Time the gravity regressor of a million poses against what it could be compared with.

    PYTHONPATH=. python benchmark/gravity_regressor.py [--poses N] [--json FILE]

Four ways to the same 7 x 10 array a pose, on one core and in one run: writing the result's memory
and nothing else, ``dvrk_gravity.gravity.regressor``, the document's formula in its printed,
expanded form column by column on whole arrays, and a loop over Pinocchio's regressors. They take
turns; only the ratios mean something elsewhere. Before anything is timed, the ways are checked
against one another.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
from units import Target, Way, as_json, in_turn, judge, ratio

from dvrk_gravity.gravity import regressor

HALF_TURN = np.pi / 2
TARGET = 3.0  # times the memory
DH = (  # alpha, a, d, theta's offset
    (HALF_TURN, 0.0, 0.0, -HALF_TURN),
    (0.0, 0.2794, 0.0, -HALF_TURN),
    (-HALF_TURN, 0.3645, 0.0, HALF_TURN),
    (HALF_TURN, 0.0, 0.1506, 0.0),
    (-HALF_TURN, 0.0, 0.0, 0.0),
    (HALF_TURN, 0.0, 0.0, -HALF_TURN),
    (0.0, 0.0, 0.0, HALF_TURN),
)


def write_memory(q: np.ndarray) -> np.ndarray:
    """Return a fresh (N, 7, 10) array with every number written once."""
    out = np.empty((len(q), 7, 10))
    out[...] = 1.0
    return out


def document_formula(q: np.ndarray) -> np.ndarray:
    """Return (N, 7, 10) from the document's expanded entries, its damaged ones mended."""
    _, c2, c3, c4, c5, c6, _ = np.cos(q.T)
    _, s2, s3, s4, s5, s6, _ = np.sin(q.T)
    y = np.zeros((len(q), 7, 10))
    y[:, 1, 0] = s2
    y[:, 1, 1] = c2
    for row in (1, 2):
        y[:, row, 2] = c2 * c3 - s2 * s3
        y[:, row, 3] = -c2 * s3 - c3 * s2
        y[:, row, 4] = c2 * c3 * c4 - c4 * s2 * s3
        y[:, row, 5] = s2 * s3 * s4 - c2 * c3 * s4
        y[:, row, 6] = c4 * s2 * s3 * s5 - c3 * c5 * s2 - c2 * c3 * c4 * s5 - c2 * c5 * s3
        y[:, row, 7] = c2 * c3 * c4 * c5 - c3 * s2 * s5 - c2 * s3 * s5 - c4 * c5 * s2 * s3
        y[:, row, 8] = (
            c2 * c3 * s4 * s6 + c2 * c6 * s3 * s5 + c3 * c6 * s2 * s5 - s2 * s3 * s4 * s6
            + c4 * c5 * c6 * s2 * s3 - c2 * c3 * c4 * c5 * c6
        )  # fmt: skip
        y[:, row, 9] = (
            c2 * c3 * c6 * s4 - c6 * s2 * s3 * s4 - c2 * s3 * s5 * s6 - c3 * s2 * s5 * s6
            - c4 * c5 * s2 * s3 * s6 + c2 * c3 * c4 * c5 * s6
        )  # fmt: skip
    s23 = np.sin(q[:, 1] + q[:, 2])
    y[:, 3, 4] = -s23 * s4
    y[:, 3, 5] = -s23 * c4
    y[:, 3, 6] = s23 * s4 * s5
    y[:, 3, 7] = -s23 * s4 * c5
    y[:, 3, 8] = s23 * (c4 * s6 + c5 * c6 * s4)
    y[:, 3, 9] = s23 * (c4 * c6 - c5 * s4 * s6)
    y[:, 4, 6] = -(c2 * c3 * s5 - s2 * s3 * s5 + c2 * c4 * c5 * s3 + c3 * c4 * c5 * s2)
    y[:, 4, 7] = -(c5 * s2 * s3 - c2 * c3 * c5 + c2 * c4 * s3 * s5 + c3 * c4 * s2 * s5)
    y[:, 4, 8] = (
        c5 * c6 * s2 * s3 - c2 * c3 * c5 * c6 + c2 * c4 * c6 * s3 * s5 + c3 * c4 * c6 * s2 * s5
    )
    y[:, 4, 9] = -(
        c5 * s2 * s3 * s6 - c2 * c3 * c5 * s6 + c2 * c4 * s3 * s5 * s6 + c3 * c4 * s2 * s5 * s6
    )
    y[:, 5, 8] = (
        c2 * c6 * s3 * s4 + c3 * c6 * s2 * s4 + c2 * c3 * s5 * s6 - s2 * s3 * s5 * s6
        + c2 * c4 * c5 * s3 * s6 + c3 * c4 * c5 * s2 * s6
    )  # fmt: skip
    y[:, 5, 9] = (
        c2 * c3 * c6 * s5 - c2 * s3 * s4 * s6 - c3 * s2 * s4 * s6 - c6 * s2 * s3 * s5
        + c2 * c4 * c5 * c6 * s3 + c3 * c4 * c5 * c6 * s2
    )  # fmt: skip
    return y


def pinocchio_arm() -> pin.Model:
    """Return the serial chain of the DH table, every link with some mass."""
    model = pin.Model()
    joint, before = 0, pin.SE3.Identity()
    for number, (alpha, a, d, offset) in enumerate(DH, start=1):
        placement = before * pin.SE3(pin.utils.rotate("z", offset), np.zeros(3))
        joint = model.addJoint(joint, pin.JointModelRZ(), placement, f"joint{number}")
        before = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0.0, d]))
        inertia = pin.Inertia(0.1 * number, np.array([0.01, 0.02, -0.03]), 1e-3 * np.eye(3))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return model


def check(model: pin.Model, q: np.ndarray) -> None:
    """Compare the ways with one another.

    Raises:
        SystemExit: two of them differ.
    """
    data = model.createData()
    y = regressor(q)
    tau = np.array([pin.computeGeneralizedGravity(model, data, pose) for pose in q])
    beta = np.linalg.lstsq(regressor(q, columns=12).reshape(-1, 12), tau.ravel(), rcond=None)[0]
    apart = abs(regressor(q, columns=12) @ beta - tau).max()
    if not max(abs(document_formula(q) - y).max(), apart) < 1e-12:
        raise SystemExit("the compared ways do not agree: nothing was timed")


def main() -> int:
    """Print the table; status 1 if the target is missed."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--poses", type=int, default=1_000_000)
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()

    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (arguments.poses, 7))
    few = q[:20_000]
    fewer = q[: len(q) * 10 // 14]  # the same memory for fourteen columns as for ten
    model = pinocchio_arm()
    data = model.createData()
    zero = np.zeros(7)
    check(model, q[:500])

    memory, own = "write the result's memory", "regressor"
    ways: dict[str, Way] = {
        memory: lambda: write_memory(q),
        own: lambda: regressor(q),
        "regressor, 14 columns, tilted base": lambda: regressor(fewer, (1.0, 2.0, -9.5), 14),
        "document's formula, whole columns": lambda: document_formula(q),
        "loop, Pinocchio computeStaticRegressor*": lambda: [
            pin.computeStaticRegressor(model, data, pose) for pose in few
        ],
        "loop, Pinocchio computeJointTorqueRegressor": lambda: [
            pin.computeJointTorqueRegressor(model, data, pose, zero, zero) for pose in few
        ],
    }
    times = in_turn(ways, repeats=5)
    times["regressor, 14 columns, tilted base"] *= len(q) / len(fewer)
    for name in ways:
        if name.startswith("loop"):
            times[name] *= len(q) / len(few)
    rows = {
        name: {
            "ns_per_pose": 1e9 * float(np.median(each)) / len(q),
            "times_memory": ratio(each, times[memory]),
            "times_regressor": ratio(each, times[own]),
        }
        for name, each in times.items()
    }
    print(f"{len(q)} poses; Pinocchio's loops on {len(few)} of them, scaled")
    print("* centre of mass only, 3 rows: no joint torques, but the least that Pinocchio computes")
    print(f"{'':45}{'ns/pose':>9}{'/ memory':>10}{'/ regressor':>13}")
    for name, row in rows.items():
        print(
            f"{name:45}{row['ns_per_pose']:9.0f}"
            f"{row['times_memory']:10.2f}{row['times_regressor']:13.2f}"
        )
    target = Target("regressor", rows[own]["times_memory"], TARGET, "times its memory",
                    f"{rows[own]['ns_per_pose']:.0f} ns a pose")  # fmt: skip
    met = judge([target])
    if arguments.json:
        content = {"poses": len(q), "rows": rows, "targets": as_json([target])}
        arguments.json.write_text(json.dumps(content, indent=1) + "\n")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
