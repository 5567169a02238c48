"""Further examples of what test/ shows of the diagnosis with one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from compared import again, bare
from diagnosed import (
    ARM,
    INSERTION,
    PITCH,
    ROLL,
    YAW,
    claims,
    clean,
    eye,
    identified,
    lab,
    model,
    named,
    of_seven,
    only,
    recorded,
    seven,
)

from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.recording import Recording
from testing import lab_effects
from testing.hide import hide
from testing.lab_motion import draw_other


def test_a_master_arm_that_its_model_knows_is_quiet():
    assert diagnose(of_seven(), seven().model()).verdict == "nothing_to_explain"


@pytest.mark.parametrize("seed", [1, 2])
def test_so_is_a_small_arm_in_other_motions(seed):
    assert diagnose(recorded(seed), model()).verdict == "nothing_to_explain"


@pytest.mark.parametrize("seed", [7, 9])
def test_so_is_an_identified_arm(seed):
    assert clean(seed).verdict == "nothing_to_explain"


def test_friction_that_is_hidden_in_a_master_arm_is_named():
    world, hidden = hide(seven(7), "coulomb_friction", np.random.default_rng(7))

    diagnosis = diagnose(world.record(1, 2, 10.0, 100.0), seven(7).model())

    assert ("coulomb_friction", hidden.joints) in named(diagnosis)


def test_a_load_that_an_identified_arm_carries_is_named_and_nothing_beside_it():
    world, random = lab(), np.random.default_rng(1)
    residual = np.array([error.rmse for error in identified().held_out.values()])
    truth = world.truth(draw_other(world.arm, int(random.integers(1 << 30))), 12.0)
    hiding = lab_effects.hide(world.setting(truth, residual), "payload", random)

    diagnosis = diagnose(world.record(hiding.truth, 1), identified().model)

    assert ("payload", hiding.hidden.joints) in claims(diagnosis)
    assert len(diagnosis.findings) == 1


# Against a reference.


def test_what_is_wrong_with_both_recordings_is_said_once():
    def frozen(recording: Recording, first: int) -> Recording:
        position = recording.position.copy()
        position[first : first + 12, PITCH] = position[first, PITCH]
        return replace(recording, position=position)

    diagnosis = diagnose(frozen(again(), 500), arm=ARM, reference=frozen(bare(), 900))

    said = [(warning.kind, warning.joint) for warning in diagnosis.warnings]
    assert said
    assert len(said) == len(set(said))


# Readings.
@pytest.mark.parametrize("joint", [YAW, PITCH])
def test_one_wrong_sign_of_efforts_is_told(joint):
    wrong = recorded().effort * (1.0 - 2.0 * eye(joint))

    found = only(diagnose(replace(recorded(), effort=wrong), model()))

    assert found.place == f"the effort of {ARM.joint_names[joint]} has the wrong sign"


def test_two_joints_whose_efforts_alone_are_exchanged_are_told():
    order = [PITCH, YAW, INSERTION, ROLL]

    found = only(diagnose(replace(recorded(), effort=recorded().effort[:, order]), model()))

    assert found.place == "the efforts of yaw and pitch are exchanged"
