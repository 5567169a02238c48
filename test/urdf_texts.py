"""URDFs written for tests, link by link and joint by joint."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
    'iyz="0"/></inertial></link>'
)
LIMIT = '<limit lower="-1" upper="2" effort="3" velocity="4"/>'


def a_joint(
    name: str, parent: str, child: str, kind: str = "revolute", inner: str = LIMIT,
    axis: str = "0 0 1",
) -> str:  # fmt: skip
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 0.2" rpy="0.3 0 0"/><axis xyz="{axis}"/>{inner}</joint>'
    )


def mimic(master: str, factor: float | str = 1.0, offset: float = 0.0) -> str:
    """Return the limits of a joint that follows another."""
    return f'{LIMIT}<mimic joint="{master}" multiplier="{factor}" offset="{offset}"/>'


def urdf(
    folder: Path, *joints: str, links: Iterable[str] = "abcd", head: str = '<robot name="r">'
) -> Path:
    """Write a file of joints between links of one letter."""
    path = folder / "robot.urdf"
    whole = head + "".join(LINK.format(link) for link in links) + "".join(joints) + "</robot>"
    path.write_text(whole)
    return path


def small(
    folder: Path, name: str = "robot.urdf", limit: str = "", moments: str = "0.02 0.02 0.01"
) -> Path:
    """An arm of two joints, which lean."""
    xx, yy, zz = moments.split()
    link = (
        '<link name="{}"><inertial><origin xyz="0 0.05 0.1"/><mass value="2"/><inertia ixx="{}" '
        'iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    limit = limit or '<limit lower="-1.5" upper="2" effort="30" velocity="3"/>'
    lower = a_joint("one", "a", "b", inner=limit, axis="0 1 0")
    upper = a_joint("two", "b", "c", inner=limit, axis="1 0 0")
    path = folder / name
    links = link.format("b", xx, yy, zz) + link.format("c", 0.02, 0.02, 0.01)
    path.write_text(f'<robot name="r"><link name="a"/>{links}{lower}{upper}</robot>')
    return path
