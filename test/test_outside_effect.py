"""An effect that the package has never heard of goes all the way: one file, and it is known.

It is defined in ``quadratic_drag.py`` beside this file, as ``docs/adding_an_effect.md`` shows it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import quadratic_drag
from known_mtm import truth
from quadratic_drag import DragHypothesis, QuadraticDrag

from dvrk_gravity import TorqueModel, diagnose, effects, identify
from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import load
from dvrk_gravity.effects import Column, Range, added
from dvrk_gravity.effects.base import registry
from dvrk_gravity.errors import ConfigError, EffectError
from dvrk_gravity.model import identified
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import diagnosis_page
from dvrk_gravity.simulate import PlantFile
from testing.hidden_parts import on_joint
from testing.world import COARSE, World

ARM = Arm.load("mtmr")
DRAG = [0.01 * (j + 1) for j in range(ARM.n)]
REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(autouse=True)
def known(monkeypatch):
    """Register it by call, and leave the package as it was."""
    monkeypatch.setattr(registry, "_effects", dict(registry._effects))
    effects.register(QuadraticDrag)


@pytest.fixture
def file(tmp_path) -> Path:
    model = TorqueModel.load(REPOSITORY / "config" / "mtmr_28002.yaml")
    path = tmp_path / "model.yaml"
    replace(model, terms=(*model.terms, QuadraticDrag(np.array(DRAG)))).save(path)
    return path


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
    start, dt, steps = 3.0, 1e-4, 4000
    plant.reset(np.zeros(ARM.n), start * np.eye(ARM.n)[6])
    inertia = float(plant.mass_matrix()[6, 6])
    held = np.eye(ARM.n)[6] == 0.0
    for _ in range(steps):
        plant.step(np.zeros(ARM.n), dt=dt)
        plant.v[held] = 0.0
    expected = start / (1.0 + 0.02 * start * dt * steps / inertia)
    assert plant.v[6] == pytest.approx(expected, rel=0.02)


def test_it_is_identified_beside_the_others():
    assert "quadratic_drag" in identified(ARM)
    drag = np.array([0.0, 0.1, 0.0, 0.0, 0.004, 0.0, 0.0])
    recording = truth(1, 16.0)
    effort = recording.effort + drag * np.abs(recording.velocity) * recording.velocity
    names = ["coulomb_friction", "viscous_friction", "quadratic_drag"]
    fit = identify([replace(recording, effort=effort)], ARM, "joint", names)
    found = fit.model.term("quadratic_drag")
    assert isinstance(found, QuadraticDrag)
    np.testing.assert_allclose(found.drag, drag, atol=0.15 * drag.max())
    (parameter,) = (
        parameter
        for parameter in fit.parameters
        if parameter.name == "quadratic_drag.joint[shoulder_pitch]"
    )
    assert parameter.unit == "N·m·s^2/rad^2"
    assert parameter.ci95[0] <= 0.1 <= parameter.ci95[1]


@pytest.fixture(scope="module")
def world() -> tuple[TorqueModel, Recording]:
    """A model that has it not, and a recording of an arm that has."""
    plain = World.draw(7, step=COARSE)
    drag = on_joint(1, lambda time, q, v: 0.4 * abs(v) * v)
    return plain.model(), replace(plain, extra=(drag,)).record(3, 4, 12.0, 100.0)


@pytest.fixture(scope="module")
def hidden(world):
    """What a diagnosis makes of it."""
    model, recording = world
    before = dict(registry._effects)
    try:
        effects.register(QuadraticDrag)
        return diagnose(recording, model), recording
    finally:
        registry._effects.clear()
        registry._effects.update(before)


def test_hidden_in_an_arm_it_is_found_with_its_size(hidden):
    diagnosis, _ = hidden
    first = diagnosis.findings[0]
    assert (first.effect, first.joints) == ("quadratic_drag", ("shoulder_pitch",))
    coefficient = first.parameters["coefficient"]
    assert coefficient.unit == "N·m·s^2/rad^2"
    assert abs(coefficient.value - 0.4) < 0.04 or coefficient.low <= 0.4 <= coefficient.high


def test_the_report_tells_it_in_its_own_words(hidden):
    diagnosis, _ = hidden
    text = diagnosis_page(diagnosis, ["run.csv"])
    assert "shoulder_pitch stirs a fluid" in text
    assert "more drag than the model" in text
    assert json.loads(diagnosis.to_json())["findings"][0]["effect"] == "quadratic_drag"


def test_the_extended_model_has_it_and_explains_the_recording(hidden, tmp_path):
    diagnosis, recording = hidden
    assert diagnosis.findings[0].in_model
    diagnosis.model.save(tmp_path / "extended_model.yaml")
    again = diagnose(recording, TorqueModel.load(tmp_path / "extended_model.yaml"))
    assert "quadratic_drag" not in [finding.effect for finding in again.findings]


def test_another_package_registers_it_by_its_entry_point(file, tmp_path):
    """As ``pip install`` leaves it: a distribution with an entry point, and its module."""
    info = tmp_path / "stirred-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stirred\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[dvrk_gravity.effects]\nquadratic_drag = quadratic_drag:QuadraticDrag\n"
    )
    source = Path(__file__).with_name("quadratic_drag.py").read_text()
    (tmp_path / "quadratic_drag.py").write_text(source)
    load = f"from dvrk_gravity import TorqueModel; print(TorqueModel.load({str(file)!r}))"
    paths = os.pathsep.join([str(tmp_path), str(REPOSITORY)])
    result = subprocess.run(
        [sys.executable, "-c", load], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip
    assert "quadratic_drag" in result.stdout, result.stderr


def test_a_model_file_says_so_when_its_effect_is_not_installed(file, monkeypatch):
    there = {name: e for name, e in registry._effects.items() if name != QuadraticDrag.NAME}
    monkeypatch.setattr(registry, "_effects", there)
    expected = (
        r"no installed effect \(entry points dvrk_gravity\.effects\) declares quadratic_drag: "
        r"is its package missing\?$"
    )
    with pytest.raises(ConfigError, match=expected):
        TorqueModel.load(file)


def test_a_name_that_another_effect_has_is_refused():
    with pytest.raises(EffectError, match="quadratic_drag: is registered already"):
        effects.register(type("Other", (QuadraticDrag,), {}))


@pytest.mark.parametrize(
    ("no_effect", "why"),
    [
        (QuadraticDrag(np.zeros(7)), "is no class derived from"),
        (dict, "is no class derived from"),
        (type("Nameless", (effects.Effect,), {}), "Nameless: NAME is '', expected an identifier"),
        (type("Bad", (QuadraticDrag,), {"NAME": "two words"}), "NAME is 'two words'"),
        (type("Half", (effects.Term,), {"NAME": "half"}), "Half does not define from_parameters, "),
        (
            type("Rub", (QuadraticDrag,), {"NAME": "rub", "scaled": effects.Term.scaled}),
            "rub: FRICTION is True, which needs a method `scaled`",
        ),
    ],
    ids=["an instance", "any class", "no name", "no identifier", "abstract", "no part of friction"],
)  # fmt: skip
def test_what_is_no_whole_effect_is_refused(no_effect, why):
    before = dict(registry._effects)
    with pytest.raises(EffectError, match=why):
        effects.register(no_effect)
    assert registry._effects == before


def added_in_another_unit(self, values, theta, motion):
    return added(self.arm, values, self.effect, self.site.index, 57.3 * float(theta[0]))


def forgets_where_it_was(cls, arm, values):
    return None


@pytest.mark.parametrize(
    ("owner", "method", "wrong"),
    [
        pytest.param(DragHypothesis, "merge", added_in_another_unit, marks=pytest.mark.slow),
        (QuadraticDrag, "from_parameters", classmethod(forgets_where_it_was)),
    ],
    ids=["another unit in merge", "not read from files"],
)
def test_what_a_model_would_have_otherwise_is_found_but_left_out_of_it(
    world, owner, method, wrong, monkeypatch
):
    monkeypatch.setattr(owner, method, wrong)
    model, recording = world
    diagnosis = diagnose(recording, model)
    (finding,) = diagnosis.findings
    assert finding.effect == "quadratic_drag"
    assert not finding.in_model
    (note,) = [note for note in diagnosis.notes if "left out of the extended model" in note]
    assert "quadratic_drag at shoulder_pitch" in note
    q = recording.position
    got, given = (m.torque(q, np.ones_like(q)) for m in (diagnosis.model, model))
    np.testing.assert_allclose(got, given, atol=1e-12)


@pytest.mark.parametrize(
    ("method", "wrong", "why"),
    [
        ("regressor", lambda self, motion: motion.q, r"`regressor` returns shape \(\d+, 7\)"),
        (
            "regressor",
            lambda self, motion: np.full((len(motion.q), 7, 1), np.nan),
            "`regressor` is not finite",
        ),
        ("CLAIM", "{where} stirs {coeficient}", "CLAIM .*'coeficient', expected of where, "),
    ],
    ids=["shape", "not finite", "claim"],
)
def test_a_slip_in_a_hypothesis_is_told_by_the_effect_s_name(
    world, method, wrong, why, monkeypatch
):
    monkeypatch.setattr(DragHypothesis, method, wrong)
    model, recording = world
    with pytest.raises(EffectError, match=f"effect quadratic_drag: {why}"):
        diagnose(recording, model)


def one_number_too_many(self, values, theta, motion):
    return {**values, self.effect: (0.1,) * (self.arm.n + 1)}


def test_a_finding_that_a_model_file_refuses_is_told_with_the_file_s_reason(world, monkeypatch):
    monkeypatch.setattr(DragHypothesis, "merge", one_number_too_many)
    model, recording = world
    diagnosis = diagnose(recording, model)
    (finding,) = diagnosis.findings
    reason = "a model file refuses it: quadratic_drag: "
    assert finding.left_out == f"{reason}got '8 numbers', expected 7 numbers"
    assert f"no: {reason}" in diagnosis_page(diagnosis, ["run.csv"])


def test_coefficients_without_a_column_are_told_by_the_effect_s_name(monkeypatch):
    fewer = classmethod(lambda cls, arm, valid: cls(np.ones(arm.n - 1)))
    monkeypatch.setattr(QuadraticDrag, "plausible", fewer)
    with pytest.raises(EffectError, match=r"quadratic_drag: `regressor` .* has 6 coefficients"):
        identify([truth(1, 12.0)], ARM, "joint", ["quadratic_drag"])


@pytest.mark.parametrize(
    ("method", "wrong", "why"),
    [
        ("regressor", lambda self, state: np.full((*state.q.shape, ARM.n), np.nan), "is not fin"),
        (
            "plausible",
            classmethod(lambda cls, arm, valid: cls(np.zeros(arm.n))),
            "scale is 0.0, expected above 0",
        ),
    ],
    ids=["columns", "prior"],
)
def test_columns_that_no_fit_can_use_are_told_by_the_effect_s_name(method, wrong, why, monkeypatch):
    monkeypatch.setattr(QuadraticDrag, method, wrong)
    with pytest.raises(EffectError, match=f"effect quadratic_drag: .*{why}"):
        identify([truth(1, 12.0)], ARM, "joint", ["quadratic_drag"])


@pytest.mark.parametrize(
    ("method", "wrong", "why"),
    [
        ("torque", lambda self, state: -self.regressor(state) @ self.drag, "`torque` is not `reg"),
        ("parameters", lambda self: {}, "`from_parameters` does not restore what"),
        (
            "with_theta",
            lambda self, theta: QuadraticDrag(-theta),
            "`theta` differs from `with_theta`",
        ),
    ],
    ids=["torque", "parameters", "with_theta"],
)
def test_a_model_with_another_torque_than_was_fitted_is_not_made(method, wrong, why, monkeypatch):
    monkeypatch.setattr(QuadraticDrag, method, wrong)
    recording = truth(1, 12.0)
    drag = np.array([0.0, 0.1, 0.0, 0.0, 0.004, 0.0, 0.0])
    effort = recording.effort + drag * np.abs(recording.velocity) * recording.velocity
    with pytest.raises(EffectError, match=f"effect quadratic_drag: {why}"):
        identify([replace(recording, effort=effort)], ARM, "joint", ["quadratic_drag"])


def test_an_error_in_the_code_of_an_effect_is_a_line_that_names_both(
    file, tmp_path, monkeypatch, capsys
):
    def stirred(diagonal):
        raise ZeroDivisionError("no fluid")

    monkeypatch.setattr("quadratic_drag.diagonal_columns", stirred)
    truth(1, 6.0).save(tmp_path / "run.csv")
    words = ["evaluate", str(tmp_path / "run.csv"), "--model", str(file)]
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "effect quadratic_drag: ZeroDivisionError: no fluid (" in line
    assert "quadratic_drag.py, line" in line


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


def test_the_belt_of_the_page_has_one_torque_in_all_its_methods(world):
    page = (REPOSITORY / "docs" / "adding_an_effect.md").read_text(encoding="utf-8")
    block = page.split("```python\n")[-1].split("```")[0]
    parts = block.split("# and of its hypothesis, with joints=(k, k + 1)\n")
    term, hypothesis = (textwrap.indent(part, "    ") for part in parts)
    names = {**vars(effects), **vars(quadratic_drag), "Column": Column}
    exec(BELT.format(term=term, hypothesis=hypothesis), names)
    effects.register(names["Belt"])
    model, recording = world
    motion = load([recording], model).motion
    belt = list(names["Belt"].hypotheses(motion))[2]
    columns = names["Belt"].unknowns(ARM, Range(ARM.lower, ARM.upper)).columns
    merged = TorqueModel.from_parameters(belt.merge(model.parameters(), np.array([0.3]), motion))
    torque = 0.3 * belt.regressor(motion)[:, :, 0]

    np.testing.assert_allclose(merged.torque(motion.q) - model.torque(motion.q), torque, atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(np.abs(torque).max(axis=0)), belt.joints)
    assert names["Belt"].coefficient_name(ARM, columns[2]) == f"belt[{ARM.joint_names[2]}]"


def test_a_torque_of_another_shape_is_told_by_the_effect_s_name(monkeypatch):
    monkeypatch.setattr(QuadraticDrag, "torque", lambda self, state: state.q[0])
    model = TorqueModel(ARM, (QuadraticDrag(np.array(DRAG)),))
    with pytest.raises(EffectError, match=r"`torque` returns shape \(7,\), expected \(5, 7\)"):
        model.torque(np.zeros((5, 7)))


def test_the_docs_show_this_very_effect():
    page = (REPOSITORY / "docs" / "adding_an_effect.md").read_text()
    code = page.split("```python\n")[1].split("```")[0]
    assert code == Path(__file__).with_name("quadratic_drag.py").read_text()


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("bad = no_such_module:Bad", "'no_such_module:Bad' of typo: cannot be imported"),
        ("bad = :::", "'bad' of typo: is ':::', no module:Class"),
        ("garbage", "of an installed package: its entry_points.txt has a line that is not"),
    ],
)
def test_a_package_whose_effect_cannot_be_imported_is_told_in_a_line(file, tmp_path, line, why):
    info = tmp_path / "typo-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: typo\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[dvrk_gravity.effects]\n{line}\n")
    paths = os.pathsep.join([str(tmp_path), str(REPOSITORY)])
    result = subprocess.run(
        [sys.executable, "-m", "dvrk_gravity", "evaluate", "any.csv", "--model", str(file)],
        capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip
    assert result.returncode == 2
    assert f"effect {why}" in result.stderr
    assert len(result.stderr.splitlines()) == 1
