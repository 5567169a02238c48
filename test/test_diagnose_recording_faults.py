"""A clock that runs wrong and velocities in another unit are one cause each, found first."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dvrk_gravity.diagnosis import Diagnosis, diagnose, put_right
from dvrk_gravity.effects import Gravity
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile, SimulatedArm, record_motion
from testing.hide import hide
from testing.world import COARSE, World

pytestmark = pytest.mark.usefixtures("brief_simulation")

KNOWN = World.draw(3, step=COARSE)
MODEL = KNOWN.model()
DEGREES = 180.0 / np.pi


@cache
def recorded(duration: float = 12.0) -> Recording:
    return KNOWN.record(3, 4, duration, 100.0)


def stamped(recording: Recording, factor: float) -> Recording:
    assert recording.time is not None
    return replace(recording, time=factor * recording.time)


def scaled(recording: Recording, joint: int, factor: float) -> Recording:
    assert recording.velocity is not None
    factors = np.where(np.arange(len(recording.joints)) == joint, factor, 1.0)
    return replace(recording, velocity=factors * recording.velocity)


def only(diagnosis: Diagnosis, effect: str):
    (finding,) = diagnosis.findings
    assert finding.effect == effect
    assert finding.certain
    return finding


@pytest.mark.parametrize("factor", [0.503, 2.0])
def test_a_clock_that_runs_wrong_is_the_one_cause(factor):
    diagnosis = diagnose(stamped(recorded(), factor), MODEL)

    finding = only(diagnosis, "time_scale")
    assert diagnosis.verdict == "explained"
    assert finding.parameters["factor"].value == pytest.approx(factor, rel=2e-3)
    assert finding.joints == ()
    assert not any("velocity is" in str(warning) for warning in diagnosis.warnings)


@pytest.mark.parametrize("factor", [0.503, 1.6])
def test_without_velocities_the_model_s_torques_show_the_clock(factor):
    """Inertia by its square, viscous friction by the factor, weight and Coulomb's not at all."""
    recording = replace(stamped(recorded(17.0), factor), velocity=None)

    finding = only(diagnose(recording, MODEL), "time_scale")

    factor_found = finding.parameters["factor"]
    assert factor_found.low <= factor <= factor_found.high
    assert factor_found.high / factor_found.low < 1.03
    assert "without recorded velocities" in finding.sentence


def test_a_right_clock_without_velocities_is_no_finding():
    assert diagnose(replace(recorded(), velocity=None), MODEL).findings == ()


@pytest.mark.parametrize("velocities", [True, False])
def test_the_rest_is_judged_by_the_true_clock(velocities):
    world, hidden = hide(KNOWN, "viscous_friction", np.random.default_rng(2))
    recording = stamped(world.record(3, 4, 14.0, 100.0), 0.7)
    if not velocities:
        recording = replace(recording, velocity=None)

    clock, friction = diagnose(recording, MODEL).findings

    assert (clock.effect, friction.effect) == ("time_scale", "viscous_friction")
    assert friction.joints == hidden.joints
    truth = hidden.parameters["coefficient"]
    assert friction.parameters["coefficient"].value == pytest.approx(truth, rel=0.05)


@pytest.mark.parametrize(
    ("factor", "unit"), [(DEGREES, "deg/s"), (30.0 / np.pi, "rpm"), (2.0, "another scale")]
)
def test_velocities_of_all_joints_in_another_unit_are_no_wrong_clock(factor, unit):
    """Of no unit's factor it may be either, and the model's torques decide."""
    recording = recorded()
    diagnosis = diagnose(replace(recording, velocity=factor * recording.velocity), MODEL)

    finding = only(diagnosis, "velocity_scale")
    assert (finding.joints, finding.place) == (recording.joints, unit)
    assert finding.parameters["factor"].value == pytest.approx(factor, rel=2e-3)


@pytest.mark.parametrize(("factor", "unit"), [(DEGREES, "deg/s"), (3.7, "another scale")])
def test_the_velocity_of_one_joint_in_another_unit_is_named(factor, unit):
    finding = only(diagnose(scaled(recorded(), 4, factor), MODEL), "velocity_scale")

    assert (finding.joints, finding.place) == (("wrist_pitch",), unit)
    assert finding.parameters["factor"].value == pytest.approx(factor, rel=5e-3)


def test_a_wrong_clock_and_a_velocity_in_another_unit_are_told_apart():
    recording = stamped(scaled(recorded(), 4, DEGREES), 0.503)
    right = put_right([recording], MODEL, None, {})

    assert [(found.effect, found.joints) for found in right.faults] == [
        ("time_scale", ()),
        ("velocity_scale", ("wrist_pitch",)),
    ]
    assert right.faults[1].place == "deg/s"
    assert right.recordings[0].head.rate == pytest.approx(recorded().rate, rel=2e-3)


@pytest.mark.parametrize(
    ("clock", "factor", "unit"),
    [
        (1.5, DEGREES, "deg/s"),
        (0.6, DEGREES, "deg/s"),
        (0.8, 1e3, "mrad/s"),
        (2.0, DEGREES, "deg/s"),
    ],
)
def test_a_wrong_clock_and_all_velocities_in_another_unit_are_both_found(clock, factor, unit):
    recording = stamped(recorded(), clock)
    right = put_right([replace(recording, velocity=factor * recording.velocity)], MODEL, None, {})

    assert [found.effect for found in right.faults] == ["time_scale", "velocity_scale"]
    assert right.faults[0].factor.value == pytest.approx(clock, rel=5e-3)
    assert (right.faults[1].joints, right.faults[1].place) == (recording.joints, unit)
    assert right.recordings[0].head.rate == pytest.approx(recorded().rate, rel=5e-3)


def test_the_clock_is_right_where_any_velocity_fits_it():
    recording = recorded()
    for joint in range(5):
        recording = scaled(recording, joint, 2.0)
    found = put_right([recording], MODEL, None, {}).faults

    assert {finding.effect for finding in found} == {"velocity_scale"}
    assert [finding.joints for finding in found] == [(name,) for name in recording.joints[:5]]


def test_the_velocity_of_a_joint_that_slides_may_be_in_millimetres():
    plant = PlantFile.load("ecm")
    arm = SimulatedArm(plant.plant(), plant.sensors, 1, dt=COARSE)
    recording = record_motion(arm, Multisine.draw(plant.model.arm, 2), 14.0, 100.0)

    diagnosis = diagnose(scaled(recording, 2, 1e3), plant.model)

    first = diagnosis.findings[0]
    assert (first.effect, first.joints, first.place) == ("velocity_scale", ("insertion",), "mm/s")


def test_a_model_without_inertia_does_not_tell_a_clock_from_velocities():
    """Then both are named; it is weight alone that it knows."""
    weight = replace(MODEL, terms=tuple(term for term in MODEL.terms if isinstance(term, Gravity)))
    (first,) = put_right([stamped(recorded(), 0.503)], weight, None, {}).faults

    assert first.effect == "time_scale"
    assert first.alternative is not None
    assert first.alternative[0] == "velocity_scale"


def test_a_wrong_clock_is_put_right_in_a_file_as_in_memory(tmp_path):
    recording = stamped(recorded(), 0.503)
    recording.save(tmp_path / "fast.csv")
    finding = only(diagnose(tmp_path / "fast.csv", MODEL), "time_scale")
    assert finding.parameters["factor"].value == pytest.approx(0.503, rel=2e-3)
