"""figaroh, as its guides and its UR10 example use it: a subclass, a configuration, ``solve``.

Options: Butterworth of order 4 at 8 Hz and its median filter of 5 samples on positions (its own
defaults but for the cut-off, which is 2 Hz there); accelerations by its gradient; its decimation by
10; friction, rotor inertia and offset at every joint (``model_components``); weighted least
squares (``solve(wls=True)``, Gautier 1997). With ``lmi`` the reported estimate is its fit under
linear matrix inequalities (``select_stage: physical_fit``, cvxopt), as in its reference example.
The example's subclass sets ``act_idxq`` and ``act_idxv``, and so does this one. Intervals are 1.96
of the relative standard deviations that it reports; the LMI fit reports none.
"""

from __future__ import annotations

import re
import sys

# fmt: off
# --- the user's lines begin ---
import tempfile
from pathlib import Path

import yaml
from exchange import INERTIAL, Case, Fitted, Parameter, read, run
from figaroh.identification import BaseIdentification
from figaroh.tools.load_robot import load_robot
from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced

CUTOFF = 8.0  # Hz


class Identification(BaseIdentification):
    """An arm whose recording is read from our CSV."""

    def load_trajectory_data(self, data_source=None):
        """Return the arrays that figaroh takes; it filters and differentiates."""
        t, q, effort = read(self.case, self.recording)
        return {"timestamps": t.reshape(-1, 1), "positions": q, "velocities": None,
                "accelerations": None, "torques": effort}


def configuration(case: Case, lmi: bool) -> str:
    """Return the path of a configuration."""
    content = {
        "robot": {"name": "arm", "properties": {"joints": {"active_joints": case.joints}}},
        "tasks": {"identification": {
            "enabled": True,
            "select_stage": "physical_fit" if lmi else "fit",
            "problem": {"include_external_forces": False, "use_joint_torques": True, "wls": True,
                        "model_components": {"friction": True, "joint_offset": True,
                                             "actuator_inertia": True}},
            "signal_processing": {"sampling_frequency": case.rate, "cutoff_frequency": CUTOFF,
                                  "filter_type": "butterworth", "filter_order": 4},
        }},
    }
    path = Path(tempfile.mkdtemp()) / "config.yaml"
    path.write_text(yaml.safe_dump(content))
    return str(path)


def identified(case: Case, recording: str, lmi: bool) -> Identification:
    """Return a solved identification."""
    robot = load_robot(case.urdf, package_dirs=str(case.folder))
    found = Identification(robot, configuration(case, lmi))
    found.case, found.recording = case, recording
    chosen = [found.model.joints[found.model.getJointId(j)] for j in case.joints]
    found.identif_config["act_idxq"] = [joint.idx_q for joint in chosen]
    found.identif_config["act_idxv"] = [joint.idx_v for joint in chosen]
    found.initialize()
    found.solve(wls=True, plotting=False)
    return found


def predict(found: Identification, lmi: bool, q, qd, qdd):
    """Return efforts (N, n)."""
    w = build_regressor_basic(found.robot, q, qd, qdd, found.identif_config)
    if lmi:
        return found.selected.predict(w).reshape(q.shape[1], -1).T
    w = build_regressor_reduced(w, found._idx_eliminated)[:, list(found._base_indices)]
    return (w @ found.phi_base).reshape(q.shape[1], -1).T


# --- the user's lines end ---
# fmt: on
LMI = "lmi" in sys.argv[3:]


def fit(case: Case, recording: str) -> Fitted:
    """Fit, and hand over what the tables need."""
    found = identified(case, recording, LMI)
    if LMI:
        if not found.selected.accepted:
            raise RuntimeError(found.selected.reason)
        values = found.selected.parameter_dict()
        bodies = {j: [values[f"{k}_{j}"] for k in INERTIAL] for j in case.joints}
        return Fitted(lambda *motion: predict(found, True, *motion), bodies=bodies)
    spread = found.result["wls_std_deviations"] / 100.0
    parameters = []
    for text, value, relative in zip(found.params_base, found.phi_base, spread, strict=True):
        combination = _combination(text)
        lead = next(iter(combination))
        half = 1.96 * relative * abs(value)
        parameters.append(Parameter(lead, value, half, combination))
    return Fitted(
        lambda *motion: predict(found, False, *motion),
        parameters,
        without_bodies="base parameters have no links",
    )


def _combination(text: str) -> dict[str, float]:
    """Return factors from figaroh's ``a + 0.5*b - 2.0*c``."""
    found = {}
    for sign, factor, name in re.findall(
        r"([+-]?)\s*(?:([\d.]+(?:e[+-]?\d+)?)\s*\*\s*)?([A-Za-z]\w*)", text
    ):
        found[name] = (-1.0 if sign == "-" else 1.0) * float(factor or 1.0)
    return found


if __name__ == "__main__":
    run(fit)
