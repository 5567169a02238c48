"""Reports as HTML pages and data frames: complete in themselves, escaped, and honest."""

from __future__ import annotations

import re
import sys
from functools import cache

import pytest
from made_results import RESULTS, TIME, Page, example_diagnosis, fit_of, poses

from dvrk_gravity import Arm
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.errors import PackageError
from dvrk_gravity.report import Remark, arm_figure, diagnosis_page, identification_page

ARM = Arm.load("mtmr")


@cache
def page_of(kind: str) -> str:
    """Return the report of a trajectory or of poses."""
    return identification_page(fit_of(TIME if kind == "trajectory" else None), "<run>.csv")


def test_a_page_is_whole_escaped_and_needs_no_network():
    for kind in ("trajectory", "poses"):
        page = Page(page_of(kind))
        assert page.open == []
        # Of each joint: torque, and what is left by position, and by velocity where it is known.
        assert len(page.addresses) == (21 if kind == "trajectory" else 14)
        assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
        assert "&lt;run&gt;.csv" in page_of(kind)
        assert "mcx(&lt;crank&gt;)" in page_of(kind)


def test_a_page_has_the_numbers_and_where_they_come_from():
    text = page_of("poses")
    for token in ("0.90 to 0.90", "10 to 70 %", "wrist_roll", "70.0 mN·m"):
        assert token in text.split("</h1>")[0]
    for token in ("a and b cannot be separated", "7 of 9", *JOINT_NAMES):
        assert token in text
    assert re.search(r"<td>mcx.*prior", text)
    assert re.search(r"<td>beta\[0\].*the data</td></tr>", text)


def test_a_diagnosis_as_a_page_has_every_finding_its_rivals_and_what_was_known():
    text = diagnosis_page(example_diagnosis(), ["<run>.csv"])
    assert Page(text).open == []
    for token in (
        "&lt;run&gt;.csv", "8 Hz", "elbow_pitch is left as it was", "look at its cables",
        "10.0 ± 5.0 mN·m more", "p &lt; 0.001", "presliding hysteresis", "viscous friction",
        "1.15 ± 0.57 deg too low",
    ):  # fmt: skip
        assert token in text, token


def marked(page: str, arm: Arm) -> dict[str, str]:
    """Return the colour of each joint in the drawing of an arm."""
    groups = re.findall(r'<g class="joint ?(\w*)">.*?<text[^>]*>(\d+)</text></g>', page)
    return {arm.joint_names[int(number) - 1]: level for level, number in groups}


def test_the_arm_is_drawn_with_the_joints_concerned():
    arm = Arm.load("mtmr")
    html = arm_figure(arm, [
        Remark("elbow_pitch", "sticks <here>", "poor"), Remark("elbow_pitch", "fine", "good"),
        Remark("outer_yaw", "fine", "good"),
    ])  # fmt: skip
    levels = marked(html, arm)
    assert list(levels) == list(JOINT_NAMES)
    assert levels == {**dict.fromkeys(JOINT_NAMES, ""), "elbow_pitch": "poor", "outer_yaw": "good"}
    assert '<li class="poor"><b>elbow_pitch</b>: sticks &lt;here&gt;; fine</li>' in html
    assert 'aria-label="mtmr: elbow_pitch marked"' in html


def test_a_result_is_a_data_frame_and_shows_itself_in_a_notebook():
    for make, first, rows in RESULTS.values():
        result = make()
        frame = result.to_dataframe()
        assert frame.columns[0] == first
        assert len(frame) == rows
        html = result._repr_html_()
        assert Page(html).open == []
        assert html.count("<tr>") == rows + 1
        assert "<a>" not in html


def test_numbers_of_a_frame_are_numbers_in_si_units():
    fit = fit_of(TIME)
    frame = fit.to_dataframe().set_index("joint")
    assert frame.loc["elbow_pitch", "rmse"] == fit.held_out["elbow_pitch"].rmse
    assert frame.loc["elbow_pitch", "unit"] == "N·m"
    assert frame["nrmse"].dtype == float


def test_without_pandas_one_line_says_what_is_needed(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    for made in (poses(), fit_of(TIME)):
        with pytest.raises(PackageError, match="pip install pandas"):
            made.to_dataframe()
    assert "<table>" in fit_of(TIME)._repr_html_()
