"""A plan: a motion for an arm with the limits that it keeps, as a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file, yaml_file
from dvrk_gravity.model import arm_beside, arm_of, seen_from, values_of
from dvrk_gravity.parameters import flatten, unflatten
from dvrk_gravity.planning.fourier import Basis, FourierMotion
from dvrk_gravity.planning.limits_file import limits_content, limits_from
from dvrk_gravity.planning.plan_limits import PlanLimits

FORMAT = 1
MOTION = "motion"
CSV_RATE = 1000.0  # Hz
_KEYS = ("format", "kind", "arm", "motion", "limits")
_MOTION = ("duration", "ramp", "frequency", "middle", "cosine", "sine")


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion from rest to rest, and what it keeps.

    Attributes:
        arm: The arm.
        motion: The motion.
        limits: What it keeps.
    """

    arm: Arm
    motion: FourierMotion
    limits: PlanLimits

    @property
    def duration(self) -> float:
        """When it is at rest again, s."""
        return self.motion.duration

    def at(self, time: float | Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, (n,) each, or (N, n) for (N,) times, s."""
        return self.motion.at(time)

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
        arm["arm"] = seen_from(str(arm["arm"]), path.parent)
        cosine, sine = np.split(self.motion.coefficients, 2)
        names, basis = self.arm.joint_names, self.motion.basis

        def by_joint(rows: Array) -> dict[str, Any]:
            return dict(zip(names, rows.T.tolist(), strict=True))

        content = {
            "format": FORMAT,
            "kind": MOTION,
            "arm": unflatten(arm),
            "motion": {
                "duration": basis.duration,
                "ramp": basis.ramp,
                "frequency": basis.frequency.tolist(),
                "middle": by_joint(self.motion.middle),
                "cosine": by_joint(cosine),
                "sine": by_joint(sine),
            },
            "limits": limits_content(self.limits, self.arm),
        }
        head = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
        text_file.write(path, head + yaml_file.dump(content))

    @classmethod
    def load(cls, path: str | Path) -> Plan:
        """Read a plan.

        Raises:
            ConfigError: Naming the file, the entry, the value and what was expected.
        """
        content = yaml_file.load(path)
        try:
            return cls._from(content, Path(path).parent)
        except ConfigError as error:
            raise error if error.source else error.in_file(path) from None

    @classmethod
    def _from(cls, content: Mapping[str, Any], folder: Path) -> Plan:
        _require_keys("", content, _KEYS)
        for name, known in (("format", FORMAT), ("kind", MOTION)):
            if content[name] != known:
                raise ConfigError(name, content[name], f"{known}, as `plan` writes it")
        if not isinstance(content["arm"], Mapping):
            raise ConfigError("arm", content["arm"], "a mapping")
        arm = arm_of(arm_beside(flatten(content["arm"]), folder))
        motion = content["motion"]
        _require_keys("motion", motion, _MOTION)
        duration, ramp = (_positive(f"motion.{name}", motion[name]) for name in _MOTION[:2])
        if 2.0 * ramp > duration:
            raise ConfigError("motion.ramp", ramp, "at most half of the duration")
        frequency = _numbers("motion.frequency", motion["frequency"], None)
        if not len(frequency) or (frequency <= 0.0).any():
            raise ConfigError("motion.frequency", frequency.tolist(), "frequencies above 0, Hz")
        rows = {}
        for name in ("middle", "cosine", "sine"):
            _require_keys(f"motion.{name}", motion[name], arm.joint_names)
            count = 1 if name == "middle" else len(frequency)
            rows[name] = np.array(
                [
                    _numbers(f"motion.{name}.{joint}", motion[name][joint], count)
                    for joint in arm.joint_names
                ]
            ).T
        limits = content["limits"]
        if not isinstance(limits, Mapping):
            raise ConfigError("limits", limits, "a mapping")
        coefficients = np.vstack([rows["cosine"], rows["sine"]])
        basis = Basis(frequency, ramp, duration)
        return cls(
            arm, FourierMotion(basis, rows["middle"][0], coefficients), limits_from(limits, arm)
        )

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


def _require_keys(where: str, entry: Any, keys: tuple[str, ...]) -> None:
    """Check that a mapping has these keys and no other."""
    if not isinstance(entry, Mapping):
        raise ConfigError(where, entry, "a mapping")
    for key in entry:
        if key not in keys:
            raise ConfigError(where, key, f"one of {', '.join(keys)}")
    for key in keys:
        if key not in entry:
            raise ConfigError(f"{where}.{key}".lstrip("."), None, "a value")


def _positive(where: str, value: Any) -> float:
    (number,) = _numbers(where, value, 1)
    if number <= 0.0:
        raise ConfigError(where, value, "a number above 0")
    return float(number)


def _numbers(where: str, value: Any, count: int | None) -> Array:
    """Return numbers in a list, or one alone."""
    listed = value if isinstance(value, list) else [value]
    good = all(
        isinstance(each, int | float) and not isinstance(each, bool) and math.isfinite(each)
        for each in listed
    )
    if not good or (count is not None and len(listed) != count):
        expected = "finite numbers" if count is None else f"{count} finite numbers"
        raise ConfigError(where, value, expected)
    return np.array(listed, dtype=float)
