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
