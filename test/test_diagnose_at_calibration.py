"""What a model left of the samples that it was identified on is no news when it comes back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.diagnosis import AtCalibration, FilteredData, diagnose, load
from dvrk_gravity.effects import PreslidingHysteresis, TimeDelay
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import identify
from dvrk_gravity.model import CalibrationSamples, KeptSettings, TorqueModel, uncertainty_file
from dvrk_gravity.recording import LowPass
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld

pytestmark = pytest.mark.usefixtures("brief_simulation")

SEED, JOINT, DURATION = 4, 1, 15.0
FRICTION = 0.4  # N·m, of one joint, that the model lacks


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    return MujocoWorld.draw("chain", SEED)


@pytest.fixture(scope="module")
def calibration(world):
    return world.record(world.truth(draw_calibration(world.arm, SEED)), SEED)


@pytest.fixture(scope="module")
def found(world, calibration) -> TorqueModel:
    return identify(calibration, world.arm).model


@pytest.fixture(scope="module")
def exact(found) -> TorqueModel:
    """Identified without that friction; at its joint it states half of it as its error."""
    error = found.uncertainty.error.copy()
    error[JOINT] = 0.5 * FRICTION
    return replace(found, uncertainty=replace(found.uncertainty, error=error, calibration=None))


def rubbed(world: MujocoWorld, motion: int, friction: float):
    """A motion of the arm, with friction that its model does not have."""
    truth = world.truth(draw_other(world.arm, motion, draw_calibration(world.arm, SEED)), DURATION)
    effort = truth.effort.copy()
    effort[:, JOINT] += friction * np.tanh(truth.qd[:, JOINT] / 0.02)
    return world.record(replace(truth, effort=effort), motion)


@pytest.fixture(scope="module")
def model(world, exact) -> TorqueModel:
    """The same, with samples of its calibration that show the friction."""
    motion = load([rubbed(world, 3, FRICTION)], exact).motion
    low = LowPass(exact.uncertainty.band, motion.rate)
    kept = CalibrationSamples.of(
        [(motion.q, motion.qd, motion.qdd, low(motion.effort))], motion.rate
    )
    return replace(exact, uncertainty=replace(exact.uncertainty, calibration=kept))


def test_what_comes_back_is_known_and_no_finding(world, exact, model):
    recording, name = rubbed(world, 4, FRICTION), world.arm.joint_names[JOINT]

    (finding,) = diagnose(recording, exact).findings
    assert (finding.effect, finding.joints) == ("coulomb_friction", (name,))

    diagnosis = diagnose(recording, model)
    assert diagnosis.verdict == "nothing_to_explain"
    assert any(
        each.joints == (name,) and "already present in the calibration recording" in each.sentence
        for each in diagnosis.known
    )


def test_more_of_it_is_news_its_interval_holds_what_came_and_the_extended_model_knows_it(
    world, model
):
    diagnosis = diagnose(rubbed(world, 4, 4 * FRICTION), model)
    (finding,) = diagnosis.findings

    assert (finding.effect, finding.joints) == (
        "coulomb_friction",
        (world.arm.joint_names[JOINT],),
    )
    size = finding.parameters["positive"]
    assert size.low < 3 * FRICTION < size.high
    assert size.value == pytest.approx(4 * FRICTION, rel=0.1)
    again = diagnose(rubbed(world, 5, 4 * FRICTION), diagnosis.model)
    assert again.findings == ()


def test_what_comes_back_widens_sizes_and_the_settings_that_were_searched_for(world, found, model):
    def widened(kept: TorqueModel) -> tuple[float, dict[str, float]]:
        motion = load([rubbed(world, 4, FRICTION)], kept).motion
        presliding = next(
            each for each in PreslidingHysteresis.hypotheses(motion) if each.site.index == JOINT
        )
        calibration = AtCalibration.of(motion)
        assert calibration is not None
        candidate = FilteredData.of(motion).candidate(presliding)
        spread, settings = calibration.spread(candidate, np.array([FRICTION]))
        return float(spread[0, 0]), settings

    level, settings = widened(model)
    level_of_a_good_one, of_a_good_one = widened(found)

    assert level > (0.5 * FRICTION) ** 2 > 4 * level_of_a_good_one
    assert settings["length"] > 4 * of_a_good_one.get("length", 0.0)


def test_a_delay_of_the_calibration_may_be_in_a_model_that_was_identified(world, found):
    """Up to a sample early or late, uniformly; nothing where the model was written down."""
    recording = rubbed(world, 4, 0.0)

    def absorbed(model: TorqueModel) -> float:
        motion = load([recording], model).motion
        claim = next(TimeDelay.hypotheses(motion))
        return claim.absorbed_variance(motion)

    sample = float(np.median(np.diff(recording.time)))
    assert absorbed(found) == pytest.approx(sample**2 / 3.0)
    assert absorbed(replace(found, uncertainty=None)) == 0.0


def test_an_extended_model_that_lacks_what_was_found_keeps_no_samples_that_show_it(world, model):
    recording = rubbed(world, 4, FRICTION)
    scaled = replace(recording, effort=recording.effort * np.array([1.3, 1.0, 1.0, 1.0]))

    diagnosis = diagnose(scaled, model)

    assert "torque_scale" in [finding.effect for finding in diagnosis.findings]
    assert diagnosis.model.uncertainty.calibration is None


def test_identify_keeps_samples_unless_terms_were_left_out_by_request(world, calibration, found):
    kept = found.uncertainty.calibration
    few = identify(calibration, world.arm, effects=["coulomb_friction"]).model

    assert len(kept.q) > 0.9 * kept.rate * (calibration.time[-1] - calibration.time[0])
    assert (
        np.abs(kept.effort - found.torque(kept.q, kept.qd, kept.qdd)).mean()
        < 0.1 * np.abs(kept.effort).mean()
    )
    assert few.uncertainty.calibration is None


def test_a_file_gives_the_samples_back(model, tmp_path):
    path = tmp_path / "model.yaml"
    model.save(path)
    kept, again = (each.uncertainty.calibration for each in (model, TorqueModel.load(path)))

    assert again.rate == kept.rate
    assert again.parts == kept.parts
    for name in ("q", "qd", "qdd", "effort"):
        assert getattr(again, name) == pytest.approx(getattr(kept, name), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda kept: {"q": kept["q"][:-1]}, "finite calibration/q of shape"),
        (lambda kept: {"effort": np.nan * kept["effort"]}, "finite calibration/effort of shape"),
        (lambda kept: {"part": kept["part"] + 1}, "calibration/part that counts from 0"),
        (lambda kept: {"part": kept["part"][:, None]}, "calibration/part with one number a sample"),
        (lambda kept: {"part": kept["part"][0]}, "calibration/part with one number a sample"),
        (lambda kept: {"rate": -kept["rate"]}, "finite calibration/rate above"),
        (lambda kept: {"rate": 0.001 * kept["rate"]}, "finite calibration/rate above 11.3 Hz"),
        (lambda kept: {"rate": kept["rate"] * np.ones(2)}, "finite calibration/rate above"),
        (lambda kept: {"qd": None}, "an array calibration/qd"),
    ],
)
def test_samples_that_cannot_be_are_refused_by_name(model, tmp_path, change, expected):
    path = tmp_path / "model.yaml"
    model.save(path)
    beside = uncertainty_file(path)
    with np.load(beside) as stored:
        arrays = dict(stored)
    kept = {
        name.removeprefix("calibration/"): array
        for name, array in arrays.items()
        if name.startswith("calibration/")
    }
    arrays |= {f"calibration/{name}": array for name, array in change(kept).items()}
    np.savez(beside, **{name: array for name, array in arrays.items() if array is not None})

    with pytest.raises(ConfigError, match=f"{beside.name}.*expected {expected}"):
        TorqueModel.load(path)


def test_of_a_long_motion_the_first_minute_is_kept():
    parts = [tuple(np.full((50, 2), float(number)) for _ in range(4)) for number in range(3)]

    kept = CalibrationSamples.of(parts, 10.0, KeptSettings(longest=8.0))

    assert [part.stop - part.start for part in kept.parts] == [50, 30]
    assert kept.effort[-1] == pytest.approx(1.0)
    assert CalibrationSamples.of([], 10.0) is None
