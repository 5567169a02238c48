"""The tables of parameters, and what their checks let through."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.effects import sensor_effects, terms
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import (
    BY_EFFECTS,
    CONSOLE_PARAMETER,
    REASON_PARAMETER,
    UNCERTAINTY_PARAMETER,
    VERDICT_PARAMETER,
    all_parameters,
    arm_parameters,
    model_parameters,
)
from dvrk_gravity.parameters import Parameter, check_all, flatten, node_parameters, unflatten

ARM = Arm.load("mtmr")
ALL_PARAMETERS = all_parameters(ARM)
MODEL_PARAMETERS = model_parameters(ARM)
NODE_PARAMETERS = node_parameters(ARM)
NUMBERS = [e for e in ALL_PARAMETERS.values() if e.kind in ("double", "double[]")]
ARRAYS = [e for e in NUMBERS if e.kind == "double[]"]


def inside(entry: Parameter) -> float:
    """A number that the parameter allows."""
    return min(max(0.5, entry.lower), entry.upper)


def lengths(entry: Parameter) -> tuple[int, ...]:
    return entry.lengths or (3,)


def with_one(entry: Parameter, bad: object) -> object:
    """A value of the right shape with one bad number: alone, or last of an array."""
    if entry.kind == "double":
        return bad
    return [inside(entry)] * (lengths(entry)[0] - 1) + [bad]


def refusal(entry: Parameter, value: object, says: str) -> ConfigError:
    """Return the error with which a parameter refuses a value."""
    with pytest.raises(ConfigError, match=says) as caught:
        pytest.fail(f"{entry.name} takes {value!r} as {entry.check(value)!r}")
    return caught.value


def test_no_name_is_declared_twice():
    declared = [CONSOLE_PARAMETER, VERDICT_PARAMETER]
    declared += [REASON_PARAMETER, UNCERTAINTY_PARAMETER, *NODE_PARAMETERS.values()]
    effects = (*terms(), *sensor_effects())
    declared += [entry for effect in effects for entry in effect.schema(ARM)]
    declared += arm_parameters(ARM)
    names = [entry.name for entry in declared] + ["joint_offset", "identification.identity"]
    names += [f"identification.{name}" for name in ("constant", "constant_is", "coordinates")]
    assert sorted(names) == sorted(set(names))
    assert set(names) == set(ALL_PARAMETERS)


def test_terms_name_their_parameters_after_themselves():
    short = {"beta", "gravity_enabled", "gravity_vector"}
    for term in terms():
        for entry in term.schema(ARM):
            assert entry.name in short or f"{entry.name}.".startswith(f"{term.NAME}.")


def test_default_passes_its_own_check_and_is_documented():
    for entry in ALL_PARAMETERS.values():
        checked = entry.check(entry.default)
        assert checked == entry.default, entry.name
        assert type(checked) is type(entry.default), entry.name
        assert entry.meaning, entry.name
        assert entry.lower <= entry.upper, entry.name
        # An arm under a person's hand: no number goes without a unit by oversight.
        if entry.kind.startswith("double") and not entry.unit:
            assert entry.name.endswith(("ratio", "depth", "tolerance"))


def test_only_finite_numbers_count_as_numbers():
    for entry in NUMBERS:
        for bad in (math.nan, math.inf, -math.inf, 10**400):
            error = refusal(entry, with_one(entry, bad), "a finite number")
            assert error.field.startswith(entry.name)
        for bad in (True, "1.0", None, [], {}, 1j):
            refusal(entry, with_one(entry, bad), "expected a number|expected a list of|numbers")


def test_every_number_is_held_to_its_lower_bound():
    for entry in (e for e in NUMBERS if math.isfinite(e.lower)):
        assert entry.check(with_one(entry, entry.lower)) is not None
        error = refusal(entry, with_one(entry, entry.lower - 1e-6), "at least|to")
        if entry.kind == "double[]":
            assert error.field == f"{entry.name}[{lengths(entry)[0] - 1}]"


def test_every_number_is_held_to_its_upper_bound():
    for entry in (e for e in NUMBERS if math.isfinite(e.upper)):
        assert entry.check(with_one(entry, entry.upper)) is not None
        refusal(entry, with_one(entry, math.nextafter(entry.upper, math.inf)), "at most|to")


def test_arrays_have_one_of_their_lengths_and_are_lists():
    for entry in ARRAYS:
        for length in range(1, 16):
            value = [inside(entry)] * length
            # Without declared lengths any will do: the term checks that its arrays fit together.
            if length in entry.lengths or not entry.lengths:
                assert entry.check(value) == tuple(value)
            else:
                refusal(entry, value, f"got '{length} numbers', expected .* numbers")
        for bad in (1.0, "1234567", b"1234567", {"a": 1.0}, None):
            refusal(entry, bad, "a list of")


def test_an_empty_array_means_not_given_only_where_that_is_the_default():
    for entry in ARRAYS:
        if entry.default == ():
            assert entry.check([]) == ()
        else:
            refusal(entry, [], "0 numbers")


def test_only_true_and_false_are_truth_values():
    for entry in (e for e in ALL_PARAMETERS.values() if e.kind == "bool"):
        assert entry.check(not entry.default) is not entry.default
        for bad in (0, 1, 0.0, "true", None, [True]):
            refusal(entry, bad, "expected true or false")


def test_a_choice_is_one_of_those_listed():
    for entry in (e for e in ALL_PARAMETERS.values() if e.choices):
        for choice in entry.choices:
            assert entry.check(choice) == choice
        for bad in ("", entry.choices[0].upper(), "none of them", 1, None, True):
            refusal(entry, bad, "expected")


def test_whole_numbers_become_floats():
    """ROS hands `[1, 2]` over as integers; a model compares and saves floats."""
    assert [type(x) for x in ALL_PARAMETERS["gravity_vector"].check([0, 0, -9])] == [float] * 3
    assert type(ALL_PARAMETERS["timeout"].check(1)) is float


def test_an_unknown_name_is_refused_with_the_nearest_one():
    for given_name, meant in (
        ("betta", "beta"), ("slew_limits", "slew_limit"),
        ("elastic_cable.elbow", "elastic_cable.elbow_pitch"),
        ("friction_compensation.deadband", "friction_compensation.dead_band"),
        ("time_out", "timeout"),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match=rf"^{given_name}: .*{meant}\?$"):
            check_all(ALL_PARAMETERS, {given_name: 1.0})
    with pytest.raises(ConfigError, match=r"^zzzz: .*[^?]$"):
        check_all(ALL_PARAMETERS, {"zzzz": 1.0})
    # A name a little like another may be that of an effect that is not installed.
    with pytest.raises(ConfigError, match=r"^belt: .*dvrk_gravity\.effects.*beta\?$"):
        check_all(ALL_PARAMETERS, {"belt": 1.0}, BY_EFFECTS)


def test_flattening_and_nesting_undo_each_other():
    tree = {"a": 1.0, "b": {"c": True, "d": {"e": [1.0, 2.0], "f": "x"}}, "g": {"h": {"i": 0.0}}}
    flat = {"a": 1.0, "b.c": True, "b.d.e": [1.0, 2.0], "b.d.f": "x", "g.h.i": 0.0}
    assert flatten(tree) == flat
    assert unflatten(flat) == tree


def test_a_parameter_given_in_both_spellings_is_refused():
    for nested in ({"a": {"b": 1}, "a.b": 2}, {"a.b": 2, "a": {"b": 1}}):
        with pytest.raises(ConfigError, match=r"a\.b: .*each parameter once"):
            flatten(nested)


def test_a_compensator_without_beta_is_refused():
    """Its arm would be commanded zero torque, and fall."""
    for values in ({}, {"beta": []}, {"viscous_friction.joint": [1.0] * 7}):
        with pytest.raises(ConfigError, match=r"^beta: got \[\]"):
            Settings.from_parameters(values)


def test_settings_that_are_not_given_are_the_table_s_and_the_arm_s():
    settings = Settings.from_parameters({"beta": [0.1] * 10})
    assert settings.limits.joint.tolist() == [1.861, 3.217, 1.96, 0.309, 0.097, 0.097, 0.023]
    assert settings.limits.actuator.tolist() == [1.861, 1.464, 1.753, 0.309, 0.097, 0.097, 0.023]
    assert settings.slew_limit.tolist() == [20, 20, 20, 5, 2, 2, 1]
    assert (settings.ramp_time, settings.timeout, settings.max_stamp_age) == (1.0, 0.1, 1.0)
    assert settings.enabled
    assert not settings.resume_automatically
    assert not settings.disable_builtin


def test_a_slew_limit_of_zero_is_the_arm_s_greatest():
    slew = [0.0, 1, 1, 1, 1, 1, 1]
    settings = Settings.from_parameters({"beta": [0.1] * 10, "slew_limit": slew})
    np.testing.assert_allclose(settings.slew_limit, [1.861 / 0.02, 1, 1, 1, 1, 1, 1.0])
