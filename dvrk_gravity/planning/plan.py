"""A plan: a motion for an arm with the limits that it keeps, as a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file, yaml_file
from dvrk_gravity.files.entries import check_count, mapping
from dvrk_gravity.model import arm_of, relative_arm_path, resolve_arm_path, values_of
from dvrk_gravity.parameters import flatten, unflatten
from dvrk_gravity.planning.fourier import Basis, FourierMotion
from dvrk_gravity.planning.limits import PlanLimits
from dvrk_gravity.planning.limits_file import KEYS, LEAST, limits_content, limits_from
from dvrk_gravity.planning.pose_path import PosePath
from dvrk_gravity.recording import STILL

FORMAT = 1
MOTION, POSES = "motion", "poses"
CSV_RATE = 1000.0  # Hz
_BLOCK = 1000  # samples worked on at a time
SEEN_RATE = 10.0  # Hz: of .6 Hz a crest is missed by 2 % of its height at most
LONGEST = 10_000.0  # s; `plan` makes 7200 s at most
MOST_WAVES = 1000  # of a motion; `plan` and `excite` make a hundred at most
_MOST = 1e6  # no position, time or frequency is greater, rad, m, s or Hz
_MOTION_KEYS = ("duration", "ramp", "frequency", "middle", "cosine", "sine")
_POSES_KEYS = ("stand", "approach", "part", "positions")


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion from rest to rest, and what it keeps.

    Attributes:
        arm: The arm.
        motion: The motion: one for trajectories, or slow poses from both sides.
        limits: What it keeps.
    """

    arm: Arm
    motion: FourierMotion | PosePath
    limits: PlanLimits

    @property
    def duration(self) -> float:
        """When it is at rest again, s."""
        return self.motion.duration

    def at(self, time: float | Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, (n,) each, or (N, n) for (N,) times, s."""
        return self.motion.at(time)

    @property
    def still(self) -> dict[str, float]:
        """Ways, rad or m, of the joints that move by less than a recording shows (``STILL``)."""
        times = np.arange(0.0, self.duration, 1.0 / SEEN_RATE)
        blocks = np.array_split(times, max(len(times) // _BLOCK, 1))  # in bounded memory
        ends = np.vstack(
            [end for block in blocks for q in self.at(block)[:1] for end in (q.min(0), q.max(0))]
        )
        way = np.ptp(ends, axis=0)
        return {
            name: float(way[k])
            for k, name in enumerate(self.arm.joint_names)
            if way[k] < STILL * self.arm.scale[k]
        }

    def save(self, path: str | Path, comment: str = "") -> None:
        """Write the plan, whole or not at all.

        Args:
            path: File to write; one that exists is replaced.
            comment: Lines put on top, without ``#``.

        Raises:
            OSError: The file cannot be written.
        """
        path = Path(path)
        arm = values_of(self.arm)
        arm["arm"] = relative_arm_path(str(arm["arm"]), path.parent)
        of_poses = isinstance(self.motion, PosePath)
        content = {
            "format": FORMAT,
            "kind": POSES if of_poses else MOTION,
            "arm": unflatten(arm),
            **self._content(),
            "limits": limits_content(self.limits, self.arm),
        }
        head = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
        text_file.write(path, head + yaml_file.dump(content))

    def _content(self) -> dict[str, Any]:
        """Return what a file has of the motion itself."""
        motion, names = self.motion, self.arm.joint_names

        def by_joint(rows: Array) -> dict[str, Any]:
            return dict(zip(names, rows.T.tolist(), strict=True))

        if isinstance(motion, PosePath):
            return {
                POSES: {
                    "stand": motion.stand,
                    "approach": by_joint(motion.approach),
                    "part": motion.part,
                    "positions": by_joint(motion.poses),
                }
            }
        cosine, sine = np.split(motion.coefficients, 2)
        return {
            MOTION: {
                "duration": motion.basis.duration,
                "ramp": motion.basis.ramp,
                "frequency": motion.basis.frequency.tolist(),
                "middle": by_joint(motion.middle),
                "cosine": by_joint(cosine),
                "sine": by_joint(sine),
            }
        }

    @classmethod
    def load(cls, path: str | Path, beyond_defaults: bool = False) -> Plan:
        """Read a plan.

        Args:
            path: The file.
            beyond_defaults: See :func:`~dvrk_gravity.planning.load_limits`, of its own limits.

        Raises:
            ConfigError: Naming the file, the entry, the value and what was expected.
        """
        content = yaml_file.load(path)
        try:
            return cls._from(content, Path(path).parent, beyond_defaults)
        except ConfigError as error:
            raise error if error.source else error.in_file(path) from None

    @classmethod
    def _from(cls, content: Mapping[str, Any], folder: Path, beyond_defaults: bool) -> Plan:
        kind = content.get("kind")
        if kind not in (MOTION, POSES):
            raise ConfigError("kind", kind, f"{MOTION} or {POSES}, as `plan` writes it")
        keys = ("format", "kind", "arm", kind, "limits")
        mapping("", content, keys, keys)
        if content["format"] != FORMAT:
            raise ConfigError("format", content["format"], f"{FORMAT}, as `plan` writes it")
        mapping("limits", content["limits"], KEYS, KEYS)  # a file that was cut lacks some
        arm = arm_of(resolve_arm_path(flatten(mapping("arm", content["arm"])), folder))
        limits = limits_from(content["limits"], arm, beyond_defaults)
        entry = content[kind]
        read = _read_motion(entry, arm) if kind == MOTION else _read_poses(entry, arm, limits)
        if not read.duration <= LONGEST:
            raise ConfigError(kind, f"{read.duration:.3g} s", f"at most {LONGEST:g} s")
        return cls(arm, read, limits)

    def write_csv(self, path: str | Path) -> None:
        """Write the motion at 1 kHz: ``time``, and position and velocity of each joint (SI).

        Raises:
            OSError: The file cannot be written.
        """
        time = np.arange(int(np.ceil(self.duration * CSV_RATE - 1e-9)) + 1) / CSV_RATE
        q, qd, _ = self.at(time)
        names = self.arm.joint_names
        columns = [f"{name}.{what}" for what in ("position", "velocity") for name in names]
        rows = np.hstack([time[:, None], q, qd])
        lines = (",".join(format(value, ".9g") for value in row) for row in rows.tolist())
        text_file.write(Path(path), "\n".join([",".join(["time", *columns]), *lines]) + "\n")


def _read_motion(entry: Any, arm: Arm) -> FourierMotion:
    mapping(MOTION, entry, _MOTION_KEYS, _MOTION_KEYS)
    duration, ramp = (_positive(f"{MOTION}.{name}", entry[name]) for name in _MOTION_KEYS[:2])
    if not 1.0 / CSV_RATE <= ramp <= 0.5 * duration:
        expected = f"at least {1.0 / CSV_RATE:g} s, and at most half of the duration"
        raise ConfigError(f"{MOTION}.ramp", ramp, expected)
    frequency = _numbers(f"{MOTION}.frequency", entry["frequency"], None)
    most = 0.5 * CSV_RATE  # of higher ones, commands at 1 kHz are another motion
    if not len(frequency) or not ((frequency > 0.0) & (frequency <= most)).all():
        expected = f"frequencies above 0 and up to {most:g} Hz"
        raise ConfigError(f"{MOTION}.frequency", frequency.tolist(), expected)
    count = len(frequency)
    check_count(f"{MOTION}.frequency", count, MOST_WAVES)
    middle, cosine, sine = (
        _by_joint(f"{MOTION}.{name}", entry[name], arm, size)
        for name, size in (("middle", 1), ("cosine", count), ("sine", count))
    )
    return FourierMotion(Basis(frequency, ramp, duration), middle[0], np.vstack([cosine, sine]))


def _read_poses(entry: Any, arm: Arm, limits: PlanLimits) -> PosePath:
    mapping(POSES, entry, _POSES_KEYS, _POSES_KEYS)
    stand, part = (_positive(f"{POSES}.{name}", entry[name]) for name in ("stand", "part"))
    if part > 1.0:
        raise ConfigError(f"{POSES}.part", part, "at most 1, the limits")
    approach = _by_joint(f"{POSES}.approach", entry["approach"], arm, 1)[0]
    poses = _by_joint(f"{POSES}.positions", entry["positions"], arm, None)
    if (approach < LEAST).any():
        raise ConfigError(
            f"{POSES}.approach", approach.tolist(), f"ways above 0, at least {LEAST:g}"
        )
    if not len(poses):
        raise ConfigError(f"{POSES}.positions", [], "at least one pose")
    return PosePath(poses, approach, stand, part, limits)


def _by_joint(where: str, entry: Any, arm: Arm, count: int | None) -> Array:
    """Return (count, n) numbers, which are given by joint."""
    mapping(where, entry, arm.joint_names, arm.joint_names)
    columns = []
    for joint in arm.joint_names:
        columns.append(_numbers(f"{where}.{joint}", entry[joint], count))
        count = len(columns[0])
    return np.array(columns).T


def _positive(where: str, value: Any) -> float:
    (number,) = _numbers(where, value, 1)
    if number < LEAST:
        raise ConfigError(where, value, f"a number above 0, at least {LEAST:g}")
    return float(number)


def _numbers(where: str, value: Any, count: int | None) -> Array:
    """Return numbers in a list, or one alone."""
    listed = value if isinstance(value, list) else [value]
    good = all(
        isinstance(each, int | float) and not isinstance(each, bool) and abs(each) <= _MOST
        for each in listed
    )
    if not good or (count is not None and len(listed) != count):
        expected = f"{'' if count is None else f'{count} '}finite numbers up to {_MOST:g}"
        raise ConfigError(where, value, expected)
    return np.array(listed, dtype=float)
