"""An effect that the package has never heard of goes all the way: one file, and it is known.

It is defined in ``quadratic_drag.py`` beside this file, as ``docs/adding_an_effect.md`` shows it.
"""

from __future__ import annotations

import json
import textwrap
from dataclasses import replace
from pathlib import Path

import known_ecm
import numpy as np
import pytest
import quadratic_drag
from known_ecm import PITCH
from quadratic_drag import DragHypothesis, QuadraticDrag
from support import MODEL_FILE, REPOSITORY

from dvrk_gravity import TorqueModel, diagnose, effects, identify
from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import extended, load
from dvrk_gravity.effects import Column, Range, added
from dvrk_gravity.effects.base import registry
from dvrk_gravity.errors import ConfigError, EffectError
from dvrk_gravity.model import identified
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import diagnosis_page
from dvrk_gravity.simulate import PlantFile

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


def test_a_simulated_arm_is_slowed_by_it_as_the_formula_says():
    """One joint, no weight, no other friction: v(t) = v0 / (1 + drag v0 t / inertia)."""
    known = PlantFile.load("mtmr_28002")
    nothing = TorqueModel(ARM, (QuadraticDrag(0.02 * np.eye(ARM.n)[6]),))
    plant = replace(known, model=nothing).plant()
    start, dt, steps = 3.0, 4e-4, 1000
    plant.reset(np.zeros(ARM.n), start * np.eye(ARM.n)[6])
    inertia = float(plant.mass_matrix()[6, 6])
    held = np.eye(ARM.n)[6] == 0.0
    for _ in range(steps):
        plant.step(np.zeros(ARM.n), dt=dt)
        plant.v[held] = 0.0
    expected = start / (1.0 + 0.02 * start * dt * steps / inertia)
    assert plant.v[6] == pytest.approx(expected, rel=0.02)


def test_it_is_identified_beside_the_others():
    assert "quadratic_drag" in identified(known_ecm.ARM)
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


@pytest.mark.parametrize(
    ("line", "refused"),
    [
        ("quadratic_drag = quadratic_drag:QuadraticDrag", ""),
        ("bad = no_such_module:Bad", "'no_such_module:Bad' of stirred: .*no_such_module"),
        ("bad = :::", "'bad' of stirred: .*':::'"),
        ("garbage", "entry_points.txt"),
    ],
)
def test_another_package_registers_it_by_its_entry_point(line, refused, tmp_path, monkeypatch):
    """As ``pip install`` leaves it: a distribution with an entry point, and its module."""
    info = tmp_path / "stirred-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stirred\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[dvrk_gravity.effects]\n{line}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry._effects.pop("quadratic_drag")
    registry._load_entry_points.cache_clear()
    try:
        if refused:
            with pytest.raises(EffectError, match=refused):
                effects.effects()
        else:
            assert QuadraticDrag in effects.effects()
    finally:
        monkeypatch.undo()
        registry._load_entry_points.cache_clear()


def test_a_model_file_says_so_when_its_effect_is_not_installed(file):
    registry._effects.pop("quadratic_drag")
    with pytest.raises(ConfigError, match=r"model\.yaml: .*quadratic_drag.*dvrk_gravity\.effects"):
        TorqueModel.load(file)


@pytest.mark.parametrize(
    ("no_effect", "why"),
    [
        (QuadraticDrag(np.zeros(7)), "is no class derived from"),
        (type("Other", (QuadraticDrag,), {}), "quadratic_drag: is registered already"),
        (dict, "is no class derived from"),
        (type("Nameless", (effects.Effect,), {}), "Nameless: NAME is '', expected an identifier"),
        (type("Bad", (QuadraticDrag,), {"NAME": "two words"}), "NAME is 'two words'"),
        (type("Half", (effects.Term,), {"NAME": "half"}), "Half does not define from_parameters, "),
        (
            type("Rub", (QuadraticDrag,), {"NAME": "rub", "scaled": effects.Term.scaled}),
            "rub: FRICTION is True, which needs a method `scaled`",
        ),
    ],
)  # fmt: skip
def test_what_is_no_whole_effect_is_refused(no_effect, why):
    before = dict(registry._effects)
    with pytest.raises(EffectError, match=why):
        effects.register(no_effect)
    assert registry._effects == before


def merged_wrongly(monkeypatch, recording, merge) -> tuple[str, bool]:
    """Return why such a finding is left out, and whether the extended model is as before."""
    monkeypatch.setattr(DragHypothesis, "merge", merge)
    motion = load([recording], known_ecm.model()).motion
    drag = next(each for each in QuadraticDrag.hypotheses(motion) if each.joints == (PITCH,))
    model, (why,) = extended(motion, [(drag, np.array([SIZE]))])
    got, given = (each.torque(motion.q, motion.qd) for each in (model, motion.model))
    return why, np.allclose(got, given, atol=1e-12)


def test_what_a_model_would_have_otherwise_is_left_out_of_it(recording, monkeypatch):
    def in_another_unit(self, values, theta, motion):
        return added(self.arm, values, self.effect, self.site.index, 57.3 * float(theta[0]))

    def one_number_too_many(self, values, theta, motion):
        return {**values, self.effect: (0.1,) * (self.arm.n + 1)}

    for merge, reason in ((in_another_unit, ""), (one_number_too_many, "'5 numbers', expected 4")):
        why, as_before = merged_wrongly(monkeypatch, recording, merge)
        assert as_before
        assert why
        assert reason in why


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


BELT = """
@dataclass(frozen=True, eq=False)
class Belt(LinearTerm):
    NAME = "belt"
    stiffness: Array

    def parameters(self): return {{self.NAME: as_value(self.stiffness)}}
    def torque(self, state): return self.regressor(state) @ self.stiffness
    theta = property(lambda self: self.stiffness)
    def with_theta(self, theta): return Belt(theta)
    @classmethod
    def hypotheses(cls, motion):
        for k in range(motion.arm.n - 1):
            yield BeltHypothesis(arm=motion.arm, site=Site.joint(k), joints=(k, k + 1))
{term}

@dataclass(frozen=True, eq=False, kw_only=True)
class BeltHypothesis(Hypothesis):
    EFFECT = Belt
    CLAIM = "a belt ties {{joint}} to {{other}}: {{stiffness}} pull than {{model}}"
    def parameters(self, theta): return {{"stiffness": float(theta[0])}}
{hypothesis}
"""


def test_the_belt_of_the_page_has_one_torque_in_all_its_methods(recording):
    page = (REPOSITORY / "docs" / "adding_an_effect.md").read_text(encoding="utf-8")
    block = page.split("```python\n")[-1].split("```")[0]
    parts = block.split("# and of its hypothesis, with joints=(k, k + 1)\n")
    term, hypothesis = (textwrap.indent(part, "    ") for part in parts)
    names = {**vars(effects), **vars(quadratic_drag), "Column": Column}
    exec(BELT.format(term=term, hypothesis=hypothesis), names)
    effects.register(names["Belt"])
    model = known_ecm.model()
    motion, arm = load([recording], model).motion, known_ecm.ARM
    belt = list(names["Belt"].hypotheses(motion))[1]
    columns = names["Belt"].unknowns(arm, Range(arm.lower, arm.upper)).columns
    merged = TorqueModel.from_parameters(belt.merge(model.parameters(), np.array([0.3]), motion))
    torque = 0.3 * belt.regressor(motion)[:, :, 0]

    np.testing.assert_allclose(merged.torque(motion.q) - model.torque(motion.q), torque, atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(np.abs(torque).max(axis=0)), belt.joints)
    assert names["Belt"].coefficient_name(arm, columns[1]) == f"belt[{arm.joint_names[1]}]"


def test_a_torque_of_another_shape_is_told_by_the_effect_s_name(monkeypatch):
    monkeypatch.setattr(QuadraticDrag, "torque", lambda self, state: state.q[0])
    model = TorqueModel(ARM, (QuadraticDrag(np.array(DRAG)),))
    with pytest.raises(EffectError, match=r"`torque` returns shape \(7,\), expected \(5, 7\)"):
        model.torque(np.zeros((5, 7)))


def test_the_docs_show_this_very_effect():
    page = (REPOSITORY / "docs" / "adding_an_effect.md").read_text()
    code = page.split("```python\n")[1].split("```")[0]
    assert code == Path(__file__).with_name("quadratic_drag.py").read_text()
