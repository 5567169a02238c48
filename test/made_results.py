"""A fit and a diagnosis made by hand, as reports and tables take them; a page that was written."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
from unresolved_causes import passed

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.diagnosis import (
    Alternative,
    Ambiguity,
    Contender,
    Diagnosis,
    Finding,
    Gain,
    Known,
    Picture,
)
from dvrk_gravity.effects import Estimate
from dvrk_gravity.identification import (
    Choice,
    Fit,
    FittedParameter,
    Identifiability,
    JointError,
    JointVerdict,
    Trace,
    Verdict,
    evaluate,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import MotionDesign, Multisine, Plan, PlanLimits
from dvrk_gravity.recording import Recording

ARM = Arm.load("mtmr")
ERRORS = {name: JointError(0.01 * k, 0.1 * k, 0.9) for k, name in enumerate(JOINT_NAMES, start=1)}


def fit_of(time) -> Fit:
    values = np.random.default_rng(0).normal(size=(200, 7))
    trace = Trace(
        JOINT_NAMES, time, values, None if time is None else values, values, 0.9 * values,
        "joint", True,
    )  # fmt: skip
    return Fit(
        model=TorqueModel(Arm.load("mtmr"), ()),
        held_out=ERRORS,
        training=ERRORS,
        parameters=(
            FittedParameter("beta[0]", 0.5913, "N·m", (0.54, 0.64)),
            FittedParameter("mcx(<crank>)", 0.0, "kg·m", (-1.0, 1.0), False),
        ),
        identifiability=Identifiability(7, 9, 12.0, ("a and b cannot be separated",)),
        choices=(Choice("coulomb_friction elbow_pitch", False, 0.2, 0.2, "does not improve"),),
        warnings=(),
        handling=("low-pass 5.65 Hz",),
        validation="12 blocks",
        coordinates="joint",
        samples=200,
        physical={},
        traces=(trace,),
        rest_error=np.zeros_like,
        holding={},
        verdict=Verdict("good", "", "", dict.fromkeys(JOINT_NAMES, JointVerdict("good", ""))),
    )


TIME = np.arange(200) / 50.0


class Page(HTMLParser):
    """Collects every address, and the tags that are open."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.addresses += [value for name, value in attributes if name in ("src", "href")]
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


CLEAR = Gain(0.4, 0.3, 0.5, 0.001)


def finding(effect: str, value: Estimate, gain: Gain, name: str = "coefficient") -> Finding:
    """Return a finding of one parameter."""
    return Finding(
        effect, ("elbow_pitch",), "joint", {name: value}, gain, (), (), "", None, True
    )  # fmt: skip


def example_diagnosis() -> Diagnosis:
    """Return one with something in every part of its report."""
    offset = {"offset": Estimate(-0.02, -0.03, -0.01, "rad")}
    contenders = [
        Contender("joint_offset", (joint,), offset, offset, -2.0, False, joint, 0.01)
        for joint in ("shoulder_pitch", "elbow_pitch")
    ]
    found = replace(
        finding("coulomb_friction", Estimate(0.01, 0.005, 0.015, "N·m"), Gain(0.4, 0.3, 0.5, 1e-9),
                "positive"),
        alternatives=(Alternative("presliding_hysteresis", ("elbow_pitch",), why="as well"),),
        rejected=(Alternative("viscous_friction", ("elbow_pitch",), "joint", 143.0, 59.0),),
        sentence="elbow_pitch has more",
        remedy="look at its cables",
    )  # fmt: skip
    known = Known("model_error", ("elbow_pitch",), {}, "elbow_pitch is left as it was")
    by_joint, model = dict.fromkeys(JOINT_NAMES, 0.01), TorqueModel(Arm.load("mtmr"), ())
    picture = Picture("elbow_pitch", "velocity", *np.random.default_rng(0).normal(size=(3, 50)))
    return Diagnosis(
        "ambiguous", (replace(found, picture=picture),), (known,), by_joint, by_joint,
        dict.fromkeys(JOINT_NAMES, np.nan), by_joint, "nothing", 100, 30, (), (),
        (Ambiguity(*contenders, 0.9, "a and b", "a or b"),),
        model, passed(model, 5), (), band=8.0,
    )  # fmt: skip


def poses() -> Recording:
    q = np.random.default_rng(0).uniform(-0.2, 0.2, (8, 7))
    return Recording(ARM.joint_names, None, q, None, np.ones((8, 7)))


def design() -> MotionDesign:
    plan = Plan(ARM, Multisine.draw(ARM, 1), PlanLimits.of(ARM))
    return MotionDesign(plan, (("mass <a>", "kg", 0.5, 0.1),), 3.0, ())


# By verb: what makes its result, the first column of its frame, and the number of rows.
RESULTS = {
    "identify": (lambda: fit_of(TIME), "joint", 7),
    "evaluate": (lambda: evaluate(TorqueModel(ARM, ()), poses()), "joint", 7),
    "diagnose": (example_diagnosis, "effect", 1),
    "plan": (design, "parameter", 1),
}
