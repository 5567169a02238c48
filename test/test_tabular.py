"""Results as data frames and in notebooks."""

from __future__ import annotations

import sys

import numpy as np
import pandas as pd
import pytest
from made_results import TIME, Page, example_diagnosis, fit_of

from dvrk_gravity import Arm, Recording, TorqueModel, evaluate
from dvrk_gravity.errors import DvrkGravityError, PackageError
from dvrk_gravity.planning import MotionDesign, Multisine, Plan, PlanLimits

ARM = Arm.load("mtmr")


def poses() -> Recording:
    q = np.random.default_rng(0).uniform(-0.2, 0.2, (8, 7))
    return Recording(ARM.joint_names, None, q, None, np.ones((8, 7)))


def design() -> MotionDesign:
    plan = Plan(ARM, Multisine.draw(ARM, 1), PlanLimits.of(ARM))
    return MotionDesign(plan, (("mass <a>", "kg", 0.5, 0.1),), 3.0, ())


RESULTS = {
    "identify": (lambda: fit_of(TIME), "joint", 7),
    "evaluate": (lambda: evaluate(TorqueModel(ARM, ()), poses()), "joint", 7),
    "diagnose": (example_diagnosis, "effect", 1),
    "plan": (design, "parameter", 1),
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_a_data_frame_and_shows_itself_in_a_notebook(name):
    make, first, rows = RESULTS[name]
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


def test_the_frame_of_a_recording_has_the_columns_of_its_file(tmp_path):
    recording = poses()
    recording.save(tmp_path / "run.csv")
    pd.testing.assert_frame_equal(recording.to_dataframe(), pd.read_csv(tmp_path / "run.csv"))


def test_without_pandas_one_line_says_what_is_needed(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    for made in (poses(), fit_of(TIME)):
        with pytest.raises(PackageError, match="needs pandas, expected `pip install pandas`") as e:
            made.to_dataframe()
        assert isinstance(e.value, DvrkGravityError)
        assert isinstance(e.value, ImportError)
    assert "<table>" in fit_of(TIME)._repr_html_()
