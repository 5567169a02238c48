"""An effect that the package has never heard of goes all the way: one file, and it is known.

It is defined in ``quadratic_drag.py`` in the folder above, as ``docs/adding_an_effect.md`` says.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import known_ecm
import numpy as np
import pytest
from known_ecm import PITCH
from quadratic_drag import DragHypothesis, QuadraticDrag
from support import MODEL_FILE, REPOSITORY

from dvrk_gravity import TorqueModel, diagnose, effects, identify
from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import extended, load
from dvrk_gravity.effects import added
from dvrk_gravity.effects.base import registry
from dvrk_gravity.errors import ConfigError, EffectError
from dvrk_gravity.model import fitted_effects
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import diagnosis_page

ARM = Arm.load("mtmr")
DRAG = [0.01 * (j + 1) for j in range(ARM.n)]
SIZE = 4.0  # N·m·s^2/rad^2, hidden at a joint of the small arm


@pytest.fixture(autouse=True)
def known(monkeypatch):
    """Register it by call, and leave the package as it was."""
    monkeypatch.setattr(registry, "_effects", dict(registry._effects))
    effects.register(QuadraticDrag)


@pytest.fixture
def file(tmp_path) -> Path:
    model = TorqueModel.load(MODEL_FILE)
    path = tmp_path / "model.yaml"
    replace(model, terms=(*model.terms, QuadraticDrag(np.array(DRAG)))).save(path)
    return path


def dragged(q, qd, qdd):
    return SIZE * np.eye(4)[PITCH] * np.abs(qd) * qd


@pytest.fixture(scope="module")
def recording():
    """Return a recording of an arm that has it; the model has it not."""
    return known_ecm.recorded(4, more=dragged)


def test_it_is_written_to_a_model_file_and_loaded_again(file):
    term = TorqueModel.load(file).term("quadratic_drag")
    assert isinstance(term, QuadraticDrag)
    np.testing.assert_array_equal(term.drag, DRAG)


def test_it_is_compensated_by_the_ratio_of_friction(file):
    values = TorqueModel.load(file).parameters()
    without = {name: value for name, value in values.items() if name != "quadratic_drag"}
    q, qd = np.zeros(ARM.n), np.full(ARM.n, 2.0)
    with_it, plain = (Settings.from_parameters(v).parts(q, qd)[1] for v in (values, without))
    ratio = Settings.from_parameters(values).friction_ratio
    np.testing.assert_allclose(with_it - plain, ratio * 4.0 * np.array(DRAG))


def test_it_is_identified_beside_the_others():
    assert "quadratic_drag" in fitted_effects(known_ecm.ARM)
    recording = known_ecm.recorded(1, 12.0, dragged)
    names = ["coulomb_friction", "viscous_friction", "quadratic_drag"]
    fit = identify([recording], known_ecm.ARM, "joint", names)
    found = fit.model.term("quadratic_drag")
    assert isinstance(found, QuadraticDrag)
    assert found.drag[PITCH] == pytest.approx(SIZE, rel=0.1)
    (parameter,) = (
        parameter for parameter in fit.parameters if parameter.name == "quadratic_drag.joint[pitch]"
    )
    assert parameter.unit == "N·m·s^2/rad^2"
    assert parameter.ci95[0] <= SIZE <= parameter.ci95[1]


def test_hidden_in_an_arm_it_is_found_reported_and_in_the_extended_model(recording, tmp_path):
    diagnosis = diagnose(recording, known_ecm.model())
    (found,) = diagnosis.findings
    assert (found.effect, found.joints, found.in_model) == ("quadratic_drag", ("pitch",), True)
    coefficient = found.parameters["coefficient"]
    assert coefficient.unit == "N·m·s^2/rad^2"
    assert coefficient.value == pytest.approx(SIZE, rel=0.05)
    assert "quadratic drag" in diagnosis_page(diagnosis, ["run.csv"])
    assert json.loads(diagnosis.to_json())["findings"][0]["effect"] == "quadratic_drag"
    diagnosis.model.save(tmp_path / "extended_model.yaml")
    model = TorqueModel.load(tmp_path / "extended_model.yaml")
    assert model.term("quadratic_drag").drag == pytest.approx(coefficient.value * np.eye(4)[PITCH])


# --- an effect that is not whole, or says one thing and does another ---------------------------


def test_another_package_registers_it_by_its_entry_point(tmp_path, monkeypatch):
    """As ``pip install`` leaves it: a distribution with an entry point, and its module."""
    info = tmp_path / "stirred-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stirred\nVersion: 1.0\n")
    line = "quadratic_drag = quadratic_drag:QuadraticDrag"
    (info / "entry_points.txt").write_text(f"[dvrk_gravity.effects]\n{line}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry._effects.pop("quadratic_drag")
    monkeypatch.setattr(registry, "_load_entry_points", registry._load_entry_points.__wrapped__)
    assert QuadraticDrag in effects.effects()


def test_a_model_file_says_so_when_its_effect_is_not_installed(file):
    registry._effects.pop("quadratic_drag")
    with pytest.raises(ConfigError, match=r"model\.yaml: .*quadratic_drag.*dvrk_gravity\.effects"):
        TorqueModel.load(file)


def test_a_finding_with_another_torque_than_was_fitted_is_left_out_of_the_model(
    recording, monkeypatch
):
    def in_another_unit(self, values, theta, motion):
        return added(self.arm, values, self.effect, self.site.index, 57.3 * float(theta[0]))

    monkeypatch.setattr(DragHypothesis, "merge", in_another_unit)
    diagnosis = diagnose(recording, known_ecm.model())
    (found,) = diagnosis.findings
    assert (found.effect, found.in_model) == ("quadratic_drag", False)
    q, qd = recording.position, recording.velocity
    got, given = (model.torque(q, qd) for model in (diagnosis.model, known_ecm.model()))
    np.testing.assert_allclose(got, given, atol=1e-12)


def test_a_finding_that_a_model_file_refuses_is_left_out_with_the_file_s_reason(
    recording, monkeypatch
):
    def one_number_too_many(self, values, theta, motion):
        return {**values, self.effect: (0.1,) * (self.arm.n + 1)}

    monkeypatch.setattr(DragHypothesis, "merge", one_number_too_many)
    motion = load([recording], known_ecm.model())
    drag = next(each for each in QuadraticDrag.hypotheses(motion) if each.joints == (PITCH,))
    model, (why,) = extended(motion, [(drag, np.array([SIZE]))])
    assert model.parameters() == motion.model.parameters()
    assert "quadratic_drag: got '5 numbers', expected 4" in why


@pytest.mark.parametrize(
    ("owner", "method", "wrong", "why"),
    [
        (DragHypothesis, "regressor", lambda self, motion: motion.q, r"shape \(\d+, 4\)"),
        (DragHypothesis, "regressor", lambda self, motion: np.full((len(motion.q), 4, 1), np.nan),
         "`regressor` is not finite"),
        (DragHypothesis, "CLAIM", "{where} stirs {coeficient}", "CLAIM .*'coeficient'"),
    ],
    ids=["shape", "not finite", "claim"],
)  # fmt: skip
def test_a_slip_in_a_hypothesis_is_told_by_the_effect_s_name(
    recording, owner, method, wrong, why, monkeypatch
):
    monkeypatch.setattr(owner, method, wrong)
    with pytest.raises(EffectError, match=f"effect quadratic_drag: .*{why}"):
        diagnose(recording, known_ecm.model())


@pytest.mark.parametrize(
    ("method", "wrong", "why"),
    [
        ("plausible", classmethod(lambda cls, arm, valid: cls(np.ones(arm.n - 1))),
         "3 coefficients"),
        ("plausible", classmethod(lambda cls, arm, valid: cls(np.zeros(arm.n))),
         "scale is 0.0, expected above 0"),
        ("regressor", lambda self, state: np.full((*state.q.shape, 4), np.nan), "is not fin"),
        ("torque", lambda self, state: -self.regressor(state) @ self.drag, "`torque` is not `reg"),
        ("parameters", lambda self: {}, "`from_parameters` does not restore"),
        ("with_theta", lambda self, theta: QuadraticDrag(-theta), "differs from `with_theta`"),
    ],
    ids=["fewer", "prior", "columns", "torque", "parameters", "with_theta"],
)  # fmt: skip
def test_columns_that_no_fit_can_use_and_torques_that_were_not_fitted_are_told_by_its_name(
    method, wrong, why, monkeypatch
):
    monkeypatch.setattr(QuadraticDrag, method, wrong)
    recording = known_ecm.recorded(1, 8.0, dragged)
    with pytest.raises(EffectError, match=f"effect quadratic_drag: .*{why}"):
        identify([recording], known_ecm.ARM, "joint", ["quadratic_drag"])


def test_an_error_in_the_code_of_an_effect_is_a_line_that_names_both(
    file, tmp_path, monkeypatch, capsys
):
    def stirred(diagonal):
        raise ZeroDivisionError("no fluid")

    monkeypatch.setattr("quadratic_drag.diagonal_columns", stirred)
    time = np.arange(300) / 100.0
    q, qd = 0.1 * np.sin(time)[:, None] * np.ones(7), 0.1 * np.cos(time)[:, None] * np.ones(7)
    Recording(ARM.joint_names, time, q, qd, q).save(tmp_path / "run.csv")
    assert main(["evaluate", str(tmp_path / "run.csv"), "--model", str(file)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    for token in ("quadratic_drag", "ZeroDivisionError: no fluid", "quadratic_drag.py, line"):
        assert token in line


def test_the_docs_show_this_very_effect():
    page = (REPOSITORY / "docs" / "adding_an_effect.md").read_text()
    code = page.split("```python\n")[1].split("```")[0]
    assert code == Path(__file__).parents[1].joinpath("quadratic_drag.py").read_text()
