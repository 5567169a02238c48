"""The HTML report of an identification: complete in itself, escaped, and honest."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pytest

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.identification import (
    Choice,
    Fit,
    FittedParameter,
    Identifiability,
    JointError,
    JointVerdict,
    Trace,
    Verdict,
    improvement,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.report import (
    Curve,
    Panel,
    chart,
    identification_page,
    residual_pictures,
    torque_pictures,
)

SVG = "{http://www.w3.org/2000/svg}"

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
        holding={},
        verdict=Verdict("good", "", "", dict.fromkeys(JOINT_NAMES, JointVerdict("good", ""))),
    )


TIME = np.arange(200) / 50.0


@cache
def page_of(kind: str) -> str:
    """Return the report of a trajectory or of poses."""
    return identification_page(fit_of(TIME if kind == "trajectory" else None), "run.csv")


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


@pytest.mark.parametrize("kind", ["trajectory", "poses"])
def test_the_page_is_whole_and_needs_no_network(kind):
    page = Page(page_of(kind))
    assert page.open == []
    assert len(page.addresses) == 14  # two pictures a joint
    assert all(address.startswith("data:image/svg+xml;base64,") for address in page.addresses)


def test_the_headline_tells_the_measure_of_the_table():
    headline = page_of("poses").split("</h1>")[0]
    assert "R² 0.90 to 0.90 on torque that it had not seen" in headline


@pytest.mark.parametrize(
    ("kind", "size", "label"),
    [
        ("revolute", 0.1, "torque [mN·m]"),
        ("revolute", 30.0, "torque [N·m]"),
        ("prismatic", 0.1, "force [mN]"),
    ],
)
def test_an_axis_is_of_force_where_a_joint_slides_and_of_its_size(kind, size, label):
    joint = replace(Arm.load("mtmr").joints[0], kind=kind)
    trace = fit_of(TIME).traces[0]
    scale = size / np.abs(trace.measured).max()
    sized = replace(trace, measured=scale * trace.measured, predicted=scale * trace.predicted)
    (picture,) = torque_pictures(sized, [joint])
    image = base64.b64decode(picture.removeprefix("data:image/svg+xml;base64,"))
    assert label in texts(image)


def texts(image):
    drawing = ElementTree.fromstring(image)
    return ["".join(text.itertext()) for text in drawing.iter(f"{SVG}text")]


@pytest.mark.parametrize("dots", [False, True])
def test_a_curve_goes_where_the_axes_numbers_say(dots):
    """Its corners, by the numbers' own places, are the points; what is no number is left out."""
    x, y = np.array([0.0, 1.0, np.nan, 4.0, 2.0]), np.array([-3.0, 5.0, 1.0, 0.0, np.inf])
    curve = Curve(x, y, "#123456", 1.0, "a < b", dots)
    image = chart([[Panel([curve], "x", "y", ("title",), zero=True)]], 200.0)
    assert {"x", "y", "title", "— a < b"} <= set(texts(image))
    drawing = ElementTree.fromstring(image)
    (path,) = (p.get("d") for p in drawing.iter(f"{SVG}path") if p.get("stroke") == "#123456")
    steps = np.array(re.findall(r"-?\d+", path.replace("h0", "")), dtype=float).reshape(-1, 2)
    numbers = [t for t in drawing.iter(f"{SVG}text") if re.fullmatch(r"-?[\d.]+", t.text or "")]
    below = max(float(t.get("y")) for t in numbers)
    places = [
        np.array([
            (float(t.get(axis)), float(t.text))
            for t in numbers if (float(t.get("y")) == below) == (axis == "x")
        ])
        for axis in "xy"
    ]  # fmt: skip
    drawn = np.cumsum(steps, axis=0) / 10.0 + [0.0, 4.0]  # a number hangs 4 px below its line
    read = [
        np.polyval(np.polyfit(*known.T, 1), at) for known, at in zip(places, drawn.T, strict=True)
    ]
    np.testing.assert_allclose(read, [[0.0, 1.0, 4.0], [-3.0, 5.0, 0.0]], atol=0.02)


def test_a_chart_of_constants_and_of_nothing_has_axes():
    nothing = Curve(np.zeros(0), np.zeros(0), "#000", 1.0)
    same = Curve(np.arange(3.0), np.full(3, 7.0), "#000", 1.0)
    for curve in (nothing, same):
        image = chart([[Panel([curve], "x", "y")], [Panel([curve], "x", "y")]], 200.0, False)
        assert texts(image).count("x") == 2


def test_a_picture_holds_nothing_of_the_joint_before_it():
    joint, trace = Arm.load("mtmr").joints[0], fit_of(TIME).traces[0]
    larger = replace(trace, **{
        name: np.column_stack([50.0 * values[:, 0] + 3.0, values[:, 0]])
        for name in ("position", "velocity", "measured", "predicted")
        if (values := getattr(trace, name)) is not None
    })  # fmt: skip
    alone = replace(larger, **{
        name: values[:, 1:]
        for name in ("position", "velocity", "measured", "predicted")
        if (values := getattr(larger, name)) is not None
    })  # fmt: skip
    assert list(torque_pictures(larger, [joint, joint]))[1:] == list(
        torque_pictures(alone, [joint])
    )
    assert list(residual_pictures([larger], [joint, joint]))[1:] == list(
        residual_pictures([alone], [joint])
    )


def test_a_gain_that_is_too_small_is_not_called_none():
    assert improvement("error", 0.006, 0.004, False) == (
        "improves the error, but not by enough: +0.6 ± 0.4 % of the squared error"
    )
    assert improvement("error", -0.006, 0.004, False).startswith("does not improve the error: -0.6")
    assert improvement("error", 0.06, 0.004, True).startswith("improves the error: +6.0")


def test_names_of_files_and_parameters_are_escaped():
    text = identification_page(fit_of(None), "<script>alert(1)</script>.csv")
    assert "<script>" not in text
    assert "mcx(&lt;crank&gt;)" in text


def test_what_is_not_known_stands_beside_what_is():
    text = page_of("poses")
    assert "a and b cannot be separated" in text
    counted = "7 of 9 independent combinations of parameters better than the prior does"
    assert f"{counted}; condition number 12" in text
    assert re.search(r'<tr class="open">\s*<td>mcx', text)
    assert re.search(r"<tr>\s*<td>beta\[0\]", text)
    assert "does not improve" in text
    for name in JOINT_NAMES:
        assert name in text
