"""Every check fires on its fault, with the right numbers, and is silent without it."""

from dataclasses import replace

import numpy as np
import pytest
from recording_samples import column, held, wave, with_gap

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.recording import Recording, check, compare_velocity, jumps, quantum, stale

CLEAN = wave(6000)
RUBS = 0.02 * np.sign(CLEAN.velocity)  # N·m, friction alone


def jittered(recording, spread):
    """Sample the motion off the stamps by a normal error of ``spread`` s."""
    true = recording.time + np.random.default_rng(0).normal(0, spread, len(recording))
    phase = 2 * np.pi * np.outer(true, np.linspace(0.3, 0.9, 7))
    size = np.linspace(0.4, 0.7, 7)
    return replace(recording, position=size * np.sin(phase))


def steps(size):
    return lambda values: size * np.round(values / size)


def times(factor):
    return lambda values: factor * values


def late(samples):
    return lambda values: np.roll(values, samples)


def away(way):
    return lambda values: values + way * (np.arange(len(values)) == 1000)


def stopped(values, first, stop):
    """Repeat a value from one row up to another."""
    rows = np.arange(len(values))
    return np.where((rows >= first) & (rows < stop), values[first], values)


def rippled(recording, size):
    """Add to efforts what grows with speed and is spread over all frequencies alike."""
    sign = np.random.default_rng(0).choice([-1.0, 1.0], recording.effort.shape)
    return replace(recording, effort=recording.effort + size * recording.velocity * sign)


def noisy(recording, size):
    noise = size * np.random.default_rng(0).normal(size=recording.effort.shape)
    return replace(recording, effort=recording.effort + noise)


def ripple_share(size):
    """Half of the ripple's power is above 50 Hz; 5.65 Hz have a ninth of that."""
    ripple = size**2 * np.mean(CLEAN.velocity**2, axis=0)
    torque = np.mean(CLEAN.effort**2, axis=0) + ripple
    return np.median(np.sqrt(0.5 * ripple * 5.65 / 50.0 / torque))


STILL = np.linspace(0.1, 0.101, 6000)
ODD = np.arange(6000) % 2
STATIC = replace(CLEAN, time=None, velocity=None)
SLOWLY = np.arange(6000) // 20 * 20
CLIP = 0.005

FAULTS = [
    ("invalid_stamps", None, replace(CLEAN, invalid=7), {"samples": 7}, CLEAN),
    ("repeated_stamps", None, replace(CLEAN, repeated=4), {"samples": 4}, CLEAN),
    ("stale_samples", None, held(CLEAN, [*range(100, 5900, 50), 200 + 1, 200 + 2]),
     {"samples": 118, "longest": 3}, held(CLEAN, [100, 200])),
    ("held_readings", None, replace(CLEAN, effort=CLEAN.effort[SLOWLY]),
     {"renewals_hz": 10.0, "hold_s": 0.1}, column(CLEAN, "effort", "outer_yaw", steps(5e-3))),
    ("held_readings", None, replace(held(CLEAN, np.flatnonzero(np.arange(6000) % 20)), effort=None),
     {"renewals_hz": 10.0}, replace(CLEAN, position=steps(1e-3)(0.1 * CLEAN.position))),
    ("read_jitter", None, jittered(CLEAN, 2e-3), {"jitter_s": 2e-3}, jittered(CLEAN, 5e-4)),
    ("read_jitter", None, with_gap(jittered(CLEAN, 2e-3)), {"jitter_s": 2e-3}, with_gap(CLEAN)),
    ("time_jitter", None, replace(CLEAN, time=CLEAN.time + 5e-4 * ODD), {"jitter_s": 5e-4},
     replace(CLEAN, time=CLEAN.time + 5e-5 * ODD)),
    ("gaps", None, with_gap(CLEAN), {"count": 1, "longest_s": 0.805}, CLEAN),
    ("effort_ripple", None, rippled(CLEAN, 2e-3), {"share": ripple_share(2e-3), "above_hz": 50.0},
     noisy(rippled(CLEAN, 1e-4), 2e-3)),
    ("velocity_mismatch", "wrist_roll", column(CLEAN, "velocity", "wrist_roll", times(1.18)),
     {"slope": 1.18, "lag_s": 0.0, "correlation": 1.0, "residual": 0.0},
     column(CLEAN, "velocity", "wrist_roll", times(1.01))),
    ("velocity_factor", "elbow_pitch", column(CLEAN, "velocity", "elbow_pitch", times(-2.0)),
     {"slope": -2.0}, column(CLEAN, "velocity", "elbow_pitch", times(1.18))),
    ("wrong_clock", None, replace(CLEAN, time=2.0 * CLEAN.time), {"factor": 2.0},
     column(CLEAN, "velocity", "elbow_pitch", times(2.0))),
    ("wrong_clock", None, replace(CLEAN, velocity=0.8 * CLEAN.velocity), {"factor": 0.8},
     replace(CLEAN, velocity=1.05 * CLEAN.velocity)),
    ("velocity_mismatch", "elbow_pitch", column(CLEAN, "velocity", "elbow_pitch", late(6)),
     {"slope": 1.0, "lag_s": 0.03}, column(CLEAN, "velocity", "elbow_pitch", late(1))),
    ("velocity_mismatch", "wrist_yaw", column(CLEAN, "velocity", "wrist_yaw", np.zeros_like),
     {"slope": 0.0, "residual": 0.0}, column(CLEAN, "position", "wrist_yaw", np.zeros_like)),
    ("effort_saturation", "outer_yaw",
     column(CLEAN, "effort", "outer_yaw", lambda e: np.clip(e, -CLIP, CLIP)), {"effort_nm": CLIP},
     column(CLEAN, "effort", "outer_yaw", steps(CLIP))),
    ("effort_saturation", "outer_yaw",
     column(STATIC, "effort", "outer_yaw", lambda e: np.minimum(e + 0.02, 0.02)),
     {"effort_nm": 0.02}, column(STATIC, "effort", "outer_yaw", steps(1e-4))),
    ("effort_frozen", "wrist_yaw",
     column(CLEAN, "effort", "wrist_yaw", lambda e: stopped(e, 1000, 5000)),
     {"seconds": 19.995, "from_s": 5.0, "to_s": 24.995},
     column(CLEAN, "effort", "wrist_yaw", lambda e: stopped(e, 1000, 1150))),
    ("position_quantisation", "wrist_yaw", column(CLEAN, "position", "wrist_yaw", steps(2.96e-3)),
     {"step_rad": 2.96e-3, "velocity_step": 0.592},
     column(CLEAN, "position", "wrist_yaw", steps(1e-4))),
    ("velocity_quantisation", "outer_yaw", column(CLEAN, "velocity", "outer_yaw", steps(0.1)),
     {"step": 0.1}, column(CLEAN, "velocity", "outer_yaw", steps(0.01))),
    ("effort_quantisation", "wrist_roll", column(CLEAN, "effort", "wrist_roll", steps(1e-3)),
     {"step": 1e-3}, column(CLEAN, "effort", "wrist_roll", steps(1e-4))),
    ("no_motion", "shoulder_pitch", column(CLEAN, "position", "shoulder_pitch", lambda p: STILL),
     {"range_rad": 1e-3}, column(CLEAN, "position", "shoulder_pitch", lambda p: 30 * STILL - 3)),
    ("nothing_moves", None, replace(CLEAN, position=np.tile(STILL[:, None], 7), velocity=None),
     {"range_rad": 1e-3}, CLEAN),
    ("position_unit", "wrist_roll", replace(CLEAN, position=np.rad2deg(CLEAN.position)),
     {"largest": np.rad2deg(0.7)}, replace(CLEAN, position=2 * CLEAN.position)),
    ("effort_unit", "wrist_roll", replace(CLEAN, effort=1000 * CLEAN.effort),
     {"largest": 14.3, "plausible": 0.023}, replace(CLEAN, effort=3 * CLEAN.effort)),
    ("exchanged_joints", "wrist_roll", replace(CLEAN, effort=30 * CLEAN.effort),
     {"largest": 0.43, "plausible": 0.023}, replace(CLEAN, effort=3 * CLEAN.effort)),
    ("exchanged_joints", "wrist_yaw", column(CLEAN, "position", "wrist_yaw", times(4.0)),
     {"largest": 2.8, "plausible": np.pi / 4},
     column(CLEAN, "position", "wrist_yaw", times(2.0))),
    ("position_jump", "elbow_pitch", column(CLEAN, "position", "elbow_pitch", away(3.0)),
     {"jumps": 2, "way_rad": 3.0}, column(CLEAN, "position", "elbow_pitch", away(0.1))),
    ("effort_sign", "wrist_yaw", replace(CLEAN, effort=-RUBS), {"work": -1.0},
     replace(CLEAN, effort=RUBS)),
    ("effort_sign", "wrist_yaw", replace(CLEAN, effort=0.05 - RUBS), {"work": -0.4},
     replace(CLEAN, effort=0.05 + RUBS)),
    ("time_unit", None, replace(CLEAN, time=1000 * CLEAN.time, velocity=None), {"interval": 5.0},
     replace(CLEAN, time=20 * CLEAN.time, velocity=None)),
]  # fmt: skip
UNUSABLE = {
    "held_readings",
    "nothing_moves",
    "position_unit",
    "effort_unit",
    "time_unit",
    "position_jump",
}


@pytest.mark.parametrize(("kind", "joint", "faulty", "numbers", "faultless"), FAULTS)
def test_check_fires_on_its_fault_and_is_silent_without(kind, joint, faulty, numbers, faultless):
    found = [w for w in check(faulty) if w.kind == kind and w.joint == joint]
    assert len(found) == 1
    for name, expected in numbers.items():
        assert found[0].numbers[name] == pytest.approx(expected, rel=0.1, abs=2e-3), name
    assert found[0].unusable == (kind in UNUSABLE)
    assert [w for w in check(faultless) if w.kind == kind and w.joint == joint] == []


def test_a_clean_recording_has_no_findings():
    noise = 0.02 * np.random.default_rng(0).normal(size=CLEAN.velocity.shape)
    for clean in (CLEAN, STATIC, replace(CLEAN, velocity=CLEAN.velocity + noise),
                  column(STATIC, "effort", "wrist_roll", np.zeros_like)):  # fmt: skip
        assert check(clean) == ()


@pytest.mark.parametrize("way", [0.3, -0.25])
def test_an_encoder_that_jumps_and_stays_is_one_jump(way):
    """60 rad/s for one sample of 5 ms, of a joint that moves at 1 rad/s."""
    stays = column(CLEAN, "position", "outer_yaw", lambda p: p + way * (np.arange(len(p)) >= 3000))
    (found,) = check(stays)
    assert (found.kind, found.joint, found.numbers["jumps"]) == ("position_jump", "outer_yaw", 1)
    assert found.numbers["way_rad"] == pytest.approx(way, abs=0.01)


def test_readings_renewed_every_tenth_time_and_a_sudden_start_are_no_jumps():
    renewed = replace(CLEAN, position=1.5 * CLEAN.position[np.arange(6000) // 10 * 10])
    assert jumps(renewed) == []
    slow = CLEAN.time[:600] * 10.0  # 20 Hz
    sudden = np.tile(np.clip(5.0 * (slow - 10.0), 0.0, 1.0)[:, None], 7)
    assert jumps(replace(CLEAN.rows(slice(0, 600)), time=slow, position=sudden)) == []
    for samples in (1, 2):
        assert jumps(CLEAN.rows(np.arange(samples))) == []


def rests_and_goes(position):
    """Stand still for 10 s, then go at constant speeds."""
    late = np.clip(CLEAN.time - 10.0, 0.0, None)
    return 0.3 + 0.2 * late


@pytest.mark.parametrize(
    "harmless",
    [
        column(CLEAN, "effort", "outer_yaw", lambda e: np.clip(e, -1.0, 1e-3)),
        column(CLEAN, "effort", "outer_yaw", lambda e: np.clip(e, -1e-3, 1.0)),
        column(CLEAN, "effort", "wrist_yaw", steps(0.01)),
        column(CLEAN, "effort", "wrist_yaw", lambda e: np.where(np.abs(e) < 6e-3, 0.0, 0.01)),
        column(
            column(CLEAN, "position", "wrist_yaw", rests_and_goes), "effort", "wrist_yaw",
            lambda e: np.where(CLEAN.time < 10.0, 0.0, 0.011),
        ),
        column(STATIC, "effort", "wrist_yaw", lambda e: stopped(e, 1000, 5000)),
    ],
    ids=["clipped", "clipped below", "in steps", "of two values", "smooth", "of poses"],
)  # fmt: skip
def test_efforts_that_may_stay_the_same_are_readings(harmless):
    assert "effort_frozen" not in {warning.kind for warning in check(harmless)}


def test_every_span_without_readings_counts():
    twice = column(
        CLEAN, "effort", "wrist_yaw", lambda e: stopped(stopped(e, 400, 1400), 2000, 2600)
    )
    (found,) = check(twice)
    assert found.kind == "effort_frozen"
    assert (found.numbers["from_s"], found.numbers["to_s"]) == (2.0, 6.995)
    assert found.numbers["seconds"] == pytest.approx(7.99)


def test_units_that_only_the_velocity_reveals_are_found():
    degrees = replace(wave(6000), velocity=np.rad2deg(CLEAN.velocity))
    assert all("deg/s" in w.text and not w.unusable for w in check(degrees))
    small = 0.01 * CLEAN.position
    both = replace(CLEAN, position=np.rad2deg(small), velocity=0.01 * CLEAN.velocity)
    found = check(both)
    assert [w.joint for w in found if w.unusable] == list(JOINT_NAMES)
    assert all(f"--columns NAME={w.joint}.position[deg]" in w.text for w in found)


def test_identical_samples_at_rest_are_not_stale():
    """Half a second of smooth motion between two long rests without any noise."""
    share = np.clip((CLEAN.time - 15.0) / 0.5, 0.0, 1.0)[:, None]
    smooth = 10 * share**3 - 15 * share**4 + 6 * share**5
    position = CLEAN.position[2999] + 0.3 * smooth
    resting = replace(CLEAN, position=position, velocity=None, effort=0.02 * position)
    assert check(resting) == ()
    assert (np.diff(position, axis=0) == 0).all(axis=1).sum() > 5000
    repeated = held(resting, range(3010, 3090, 2))
    assert 35 <= stale(repeated).sum() <= 80


@pytest.mark.parametrize(
    ("values", "step"),
    [
        (0.25 * np.arange(40) ** 2 % 17, 0.25),
        (np.random.default_rng(0).normal(size=5000), 0.0),
        (1e-3 * np.random.default_rng(0).integers(-900, 900, 100_000), 1e-3),
        (np.zeros(9), 0.0),
        (np.array([1.0, 2.0]), 0.0),
    ],
)
def test_quantum_is_found_only_where_there_is_one(values, step):
    assert quantum(values) == pytest.approx(step, rel=1e-9)


def test_stale_samples_are_not_held_against_the_velocity():
    rows = np.sort(np.random.default_rng(0).choice(np.arange(10, 5990), 2000, replace=False))
    slow = held(column(CLEAN, "velocity", "outer_yaw", lambda v: np.roll(v, 1)), rows)
    for fit in compare_velocity(slow):
        assert abs(fit.slope - 1.0) < 1e-3
        assert fit.residual < 0.015


def test_coarse_positions_are_in_the_unit_of_the_joint():
    arm = Arm.load("ecm")
    time = np.arange(0.0, 20.0, 0.005)
    smooth = 0.1 + 0.02 * np.sin(np.outer(time, [1.0, 1.1, 0.9, 1.2]))
    coarse = np.where(np.arange(4) >= 2, np.rint(smooth / 1e-3) * 1e-3, smooth)
    found = {
        warning.joint: warning.numbers
        for warning in check(Recording(arm.joint_names, time, coarse).of(arm))
        if warning.kind == "position_quantisation"
    }
    assert set(found) == {"insertion", "roll"}
    assert found["insertion"]["step_m"] == pytest.approx(1e-3)
    assert found["roll"]["step_rad"] == pytest.approx(1e-3)
    assert found["roll"]["velocity_step"] == pytest.approx(0.2)


@pytest.mark.parametrize(("step", "coarse"), [(3e-4, False), (3e-3, True)])
def test_steps_that_average_out_below_the_band_that_is_compared_are_not_coarse(step, coarse):
    """At 1 kHz: 3e-4 rad a sample are 0.3 rad/s, and 2 mrad/s of error below 20 Hz."""
    fast = wave(10_000, rate=1000.0)
    found = check(replace(fast, position=steps(step)(fast.position)))
    assert ("position_quantisation" in {warning.kind for warning in found}) == coarse
