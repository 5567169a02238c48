"""The arms that the package ships, identified by the names of their joints."""

from __future__ import annotations

from collections.abc import Collection
from functools import cache

from dvrk_gravity.arms import yaml_arm
from dvrk_gravity.arms.description import Description
from dvrk_gravity.arms.mtm import is_mtm
from dvrk_gravity.files.resources import config_path, shipped

PLANTS = "plants"  # folder of the simulated arms that the package ships
_MTM = "mtmr_28002"


def plausible_plant(arm: Description) -> str:
    """Return the name of the shipped plant that moves as an arm does; ``""``: none.

    It is the first whose name begins with the arm's; of any MTM ``mtmr_28002``. An arm with
    held joints has none, nor has one of a URDF, whatever its name: its file states its own masses.
    """
    whole = () if arm.held or arm.urdf else shipped(PLANTS)
    named = [name for name in whole if name.partition("_")[0] == arm.name]
    return named[0] if named else _MTM if whole and is_mtm(arm) else ""


def other_arm(arm: str, names: Collection[str]) -> str:
    """Return the shipped arms, other than the stated one, whose joints are named; ``""``: none.

    An ECM's joints are the first ones of a PSM, whose recording would be taken for an ECM's; a PSM
    and an MTM share some. Of a PSM an instrument may be missing.

    Args:
        arm: Name of the arm that was stated.
        names: Names of joints.
    """
    joints = _joints()
    if arm not in joints:
        return ""
    for other_joints in sorted(joints.values(), key=len, reverse=True):
        lacking = not joints[arm] <= set(names) and not other_joints <= joints[arm]
        if other_joints <= set(names) and (joints[arm] < other_joints or lacking):
            return " or ".join(name for name in joints if joints[name] == other_joints)
    return ""


@cache
def _joints() -> dict[str, frozenset[str]]:
    read = {name: yaml_arm.read(config_path(f"arms/{name}.yaml"), name) for name in shipped("arms")}
    return {name: frozenset(arm.joint_names) for name, arm in read.items()}
