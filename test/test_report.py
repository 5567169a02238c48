"""The HTML report of an identification: complete in itself, escaped, and honest."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_results import TIME, Page, fit_of
from matplotlib.figure import Figure

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.identification import (
    improvement,
)
from dvrk_gravity.report import (
    Remark,
    drawn_arm,
    identification_page,
    inline,
    residual_pictures,
    torque_pictures,
)


@cache
def page_of(kind: str) -> str:
    """Return the report of a trajectory or of poses."""
    return identification_page(fit_of(TIME if kind == "trajectory" else None), "run.csv")


@pytest.mark.parametrize("kind", ["trajectory", "poses"])
def test_the_page_is_whole_and_needs_no_network(kind):
    page = Page(page_of(kind))
    assert page.open == []
    # Of each joint: torque, and what is left by position, and by velocity where it is known.
    assert len(page.addresses) == (21 if kind == "trajectory" else 14)
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)


def test_the_headline_tells_the_measure_of_the_table():
    headline = page_of("poses").split("</h1>")[0]
    assert "R² 0.90 to 0.90 on torque that it had not seen" in headline
    assert "errs by 10 to 70 % of the torque, most at wrist_roll (70.0 mN·m RMS)" in headline


@pytest.mark.parametrize(
    ("kind", "size", "label"),
    [
        ("revolute", 0.1, "torque [mN·m]"),
        ("revolute", 30.0, "torque [N·m]"),
        ("prismatic", 0.1, "force [mN]"),
    ],
)
def test_an_axis_is_of_force_where_a_joint_slides_and_of_its_size(kind, size, label, monkeypatch):
    labels = []
    monkeypatch.setattr("matplotlib.axes.Axes.set_ylabel", lambda _, text: labels.append(text))
    joint = replace(Arm.load("mtmr").joints[0], kind=kind)
    trace = fit_of(TIME).traces[0]
    scale = size / np.abs(trace.measured).max()
    sized = replace(trace, measured=scale * trace.measured, predicted=scale * trace.predicted)
    list(torque_pictures(sized, [joint]))
    assert labels == [label]


@pytest.mark.parametrize("name", [r"$\frac{q$", "a$_b^$", "<b>&"])
def test_a_joint_s_name_is_text_whatever_characters_it_has(name):
    figure = Figure(figsize=(1.0, 1.0))
    figure.subplots().set_ylabel(f"error at {name} [N·m]")
    assert inline(figure).startswith("data:image/png;base64,")


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


def marked(page: str, arm: Arm) -> dict[str, str]:
    """Return the colour of each joint in the drawing of an arm."""
    groups = re.findall(r'<g class="joint ?(\w*)">.*?<text[^>]*>(\d+)</text></g>', page)
    return {arm.joint_names[int(number) - 1]: level for level, number in groups}


def test_the_arm_is_drawn_with_the_joints_concerned():
    arm = Arm.load("mtmr")
    html = drawn_arm(arm, [
        Remark("elbow_pitch", "sticks <here>", "poor"), Remark("elbow_pitch", "fine", "good"),
        Remark("outer_yaw", "fine", "good"),
    ])  # fmt: skip
    levels = marked(html, arm)
    assert list(levels) == list(JOINT_NAMES)
    assert levels == {**dict.fromkeys(JOINT_NAMES, ""), "elbow_pitch": "poor", "outer_yaw": "good"}
    assert '<li class="poor"><b>elbow_pitch</b>: sticks &lt;here&gt;; fine</li>' in html
    assert 'aria-label="mtmr: elbow_pitch marked"' in html


@pytest.mark.parametrize("name", ["mtmr", "psm", "ecm", "sliding"])
def test_no_joint_of_a_drawing_covers_another(name, tmp_path):
    arm = Arm.load(name) if name != "sliding" else sliding(tmp_path)
    html = drawn_arm(arm, [Remark("", "its base is tilted", "fair")])
    assert '<path class="base fair"' in html
    texts = re.findall(r'<text x="([-\d.]+)" y="([-\d.]+)"', html)
    places = np.array(texts, dtype=float)
    assert places.shape == (arm.n, 2)
    apart = np.linalg.norm(places[:, None] - places[None], axis=2) + 100.0 * np.eye(arm.n)
    assert apart.min() > 18.0  # the width of a joint


def sliding(folder) -> Arm:
    """Return an arm whose joints all slide along one line: its drawing has no breadth."""
    text = '<robot name="lift"><link name="l0"/>'
    for k in (1, 2):
        text += (
            f'<link name="l{k}"/><joint name="j{k}" type="prismatic"><parent link="l{k - 1}"/>'
            f'<child link="l{k}"/><axis xyz="0 0 1"/>'
            '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    (folder / "lift.urdf").write_text(text + "</robot>")
    return Arm.load(folder / "lift.urdf")


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


def test_a_command_in_the_advice_is_set_as_code():
    fit = fit_of(TIME)
    verdict = replace(fit.verdict, record="a motion (`diagnose` finds <more>)")
    text = identification_page(replace(fit, verdict=verdict), "run.csv")
    assert "Record instead: a motion (<code>diagnose</code> finds &lt;more&gt;)." in text


def test_what_is_not_known_stands_beside_what_is():
    text = page_of("poses")
    assert "a and b cannot be separated" in text
    counted = "7 of 9 independent combinations of parameters better than the prior does"
    assert f"{counted}; condition number 12" in text
    assert re.search(r"<td>mcx.*<td>a prior too</td></tr>", text)
    assert re.search(r"<td>beta\[0\].*<td>the data</td></tr>", text)
    assert "does not improve" in text
    for name in JOINT_NAMES:
        assert name in text
