"""What the benchmark hands to every method, and what it takes from it; needs NumPy alone.

A case is a folder: ``case.json``, ``arm.urdf``, ``train.csv``, further recordings, ``test.npz``.
A method's file has a function ``fit(case, recording)`` between the two markers below: what a user
writes, whose lines are counted. :func:`run` calls it, notes processor time and memory of its own
process, start-up included, and only then writes what the tables need.
"""

from __future__ import annotations

import json
import resource
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

# Between them nothing is formatted: one call a line would count against a method.
BEGIN, END = "# --- the user's lines begin ---", "# --- the user's lines end ---"
INERTIAL = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")  # Pinocchio's order
KINDS = {"fv": "viscous_friction", "fs": "coulomb_friction", "Ia": "rotor_inertia",
         "off": "torque_offset"}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A case as a method sees it.

    Attributes:
        folder: Where its files are.
        joints: Names, in the order of all arrays.
        arm: What our commands take for the arm: a name or a path.
        urdf: The arm as URDF, in joint space, with nominal masses; followers left out.
        effort_limit: (n,) N·m or N.
        rate: Of its recordings, Hz.
        truth: Standard parameters that are known, by ``PARAMETER_joint``; empty on real arms.
        recordings: Names of further recordings, to be diagnosed.
        chain_only: Why parameters of the URDF's links are not the arm's, if so.
    """

    folder: Path
    joints: list[str]
    arm: str
    urdf: str
    effort_limit: list[float]
    rate: float
    truth: dict[str, float] = field(default_factory=dict)
    recordings: list[str] = field(default_factory=list)
    chain_only: str = ""

    @classmethod
    def load(cls, folder: Path) -> Case:
        """Read a case from its folder."""
        return cls(folder=folder, **json.loads((folder / "case.json").read_text()))


@dataclass(frozen=True)
class Parameter:
    """An estimate with the 95 % interval that the method itself gives.

    Attributes:
        name: ``PARAMETER_joint`` of the first of the standard parameters that it combines.
        value: Estimate.
        half: Half of its interval; infinite where the method says so.
        combination: Factors of the standard parameters.
        truth: True value where it is no such combination.
    """

    name: str
    value: float
    half: float
    combination: Mapping[str, float] = field(default_factory=dict)
    truth: float | None = None


@dataclass(frozen=True)
class Fitted:
    """What a method found.

    Attributes:
        predict: Efforts (N, n) from positions, velocities and accelerations (N, n).
        parameters: With intervals.
        bodies: Link -> its ten parameters, where the method gives them.
        without_bodies: Why it does not.
        holding: Efforts (N, n) that hold the arm at (N, n), if not ``predict`` without motion.
    """

    predict: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    parameters: Sequence[Parameter] = ()
    bodies: Mapping[str, Sequence[float]] = field(default_factory=dict)
    without_bodies: str = ""
    holding: Callable[[np.ndarray], np.ndarray] | None = None


Fit = Callable[[Case, str], Fitted]
Diagnose = Callable[[Case, Fitted, str], list[dict[str, Any]]]


def read(case: Case, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (N,) times, (N, n) positions and efforts of a recording."""
    path = case.folder / name
    with path.open() as stream:
        header = stream.readline().strip().split(",")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    columns = [[header.index(f"{j}.{what}") for j in case.joints] for what in
               ("position", "effort")]  # fmt: skip
    return table[:, header.index("time")], table[:, columns[0]], table[:, columns[1]]


def least_eigenvalue(row: Sequence[float]) -> float:
    """Return that of a link's pseudo-inertia, over the greatest."""
    m, cx, cy, cz, xx, xy, yy, xz, yz, zz = row
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    first = np.array([[cx, cy, cz]])
    values = np.linalg.eigvalsh(np.block([[second, first.T], [first, np.array([[m]])]]))
    return float(values[0] / np.abs(values).max())


def changed(old: Fitted, new: Fitted) -> list[dict[str, Any]]:
    """Return parameters whose new interval excludes the old value, the farthest first."""
    before = {p.name: p.value for p in old.parameters}
    found = []
    for parameter in new.parameters:
        if parameter.name not in before or not np.isfinite(parameter.half):
            continue
        away = abs(parameter.value - before[parameter.name]) / max(parameter.half, 1e-300)
        if away > 1.0:
            kind, _, joint = parameter.name.partition("_")
            effect = KINDS.get(kind, "link_inertia" if kind.startswith("I") else "link_com")
            found.append({"effect": effect, "joint": joint, "away": away})
    return sorted(found, key=lambda entry: -entry["away"])


def _by_refit(fit: Fit) -> Diagnose:
    return lambda case, old, name: changed(old, fit(case, name))


def _spent() -> dict[str, float]:
    """Return processor time and peak memory; ``ru_maxrss`` would count the parent's before exec."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    peak = [line.split()[1] for line in lines if line.startswith("VmHWM")]
    gib = float(peak[0]) / 2**20 if peak else float("nan")
    return {"cpu": usage.ru_utime + usage.ru_stime, "gib": gib}


def run(fit: Fit, diagnose: Diagnose | None = None) -> None:
    """Fit a case, write its results: ``METHOD CASE OUT``; further recordings are diagnosed."""
    case, out = Case.load(Path(sys.argv[1])), Path(sys.argv[2])
    start = time.monotonic()
    result: dict[str, Any] = {}
    try:
        fitted = fit(case, "train.csv")
        result = {**_spent(), "wall": time.monotonic() - start}
        state = np.load(case.folder / "test.npz")
        q, qd, qdd = (state[name] for name in ("q", "qd", "qdd"))
        still = np.zeros_like(q)
        hold = fitted.holding or (lambda at: fitted.predict(at, still, still))
        np.savez(out.with_suffix(".npz"), torque=fitted.predict(q, qd, qdd), holding=hold(q))
        result["parameters"] = [_scored(parameter, case) for parameter in fitted.parameters]
        result["bodies"] = {name: least_eigenvalue(row) for name, row in fitted.bodies.items()}
        result["without_bodies"] = fitted.without_bodies
        result["diagnoses"] = []
        for name in case.recordings if fitted.parameters else ():
            before = time.process_time()
            found = (diagnose or _by_refit(fit))(case, fitted, name)
            spent = time.process_time() - before
            result["diagnoses"].append({"recording": name, "cpu": spent, "found": found})
    except Exception as error:
        traceback.print_exc()
        result["failure"] = f"{type(error).__name__}: {error}".splitlines()[0][:160]
    out.with_suffix(".json").write_text(json.dumps(result, indent=1))


def _scored(parameter: Parameter, case: Case) -> dict[str, Any]:
    """Return an estimate beside its truth, where that is known."""
    truth = parameter.truth
    if truth is None and parameter.combination and set(parameter.combination) <= set(case.truth):
        truth = sum(factor * case.truth[name] for name, factor in parameter.combination.items())
    return {
        "name": parameter.name, "value": float(parameter.value), "half": float(parameter.half),
        "truth": None if truth is None else float(truth),
    }  # fmt: skip
