"""What an arm has and its URDF does not is found: a load, and friction of all joints."""

from __future__ import annotations

import pytest
from robots import UR5

from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.diagnosis import diagnose
from testing.plain_world import PlainWorld

MASS, COM = 1.5, (0.02, 0.05, 0.08)  # kg, m in the last link's frame


def test_what_the_arm_has_and_the_file_does_not_is_found_at_every_joint():
    """A load, and friction of six joints of which the file says nothing."""
    arm = Arm.load(UR5)
    bare = PlainWorld.of(arm, nominal_inertias(arm))
    world = bare.with_payload(arm.body_names[-1], MASS, COM)
    diagnosed = diagnose(world.record(1, 15.0), UR5)
    found = {(finding.effect, finding.joints): finding for finding in diagnosed.findings}
    load = found["payload", world.arm.joint_names[-1:]].parameters
    assert load["mass"].value == pytest.approx(MASS, rel=0.05)
    for axis, place in zip("xyz", COM, strict=True):
        assert load[axis].value == pytest.approx(place, abs=0.01)
    for joint, level, slope in zip(
        world.arm.joint_names, world.coulomb, world.viscous, strict=True
    ):
        dry = found["coulomb_friction", (joint,)].parameters["positive"]
        assert dry.value == pytest.approx(level, rel=0.05)
        viscous = found["viscous_friction", (joint,)].parameters["coefficient"]
        assert viscous.value == pytest.approx(slope, rel=0.05)
    assert len(found) == 13
    # What a file says little of is no surprise, and no headline.
    assert diagnosed.findings[0].effect == "payload"
