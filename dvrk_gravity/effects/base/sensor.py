"""Faults of readings as effects: each declares the parameters by which a model knows of it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import as_array, as_value, joint_array
from dvrk_gravity.effects.base.effect import Effect
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

# Of a factor of a reading, or of its inverse. Units that occur (mm, mrad, mN·m, deg, rpm) are at
# most 1000 from SI; chosen: ten times that are no reading of the arm.
_MOST = 1e4


class SensorEffect(Effect):
    """A fault of a reading, which models may know of; it declares its own parameters."""

    READS_WRONGLY = True

    @classmethod
    @abstractmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        """Return the declarations of its parameters in an arm's files, ``reading.*``."""

    @classmethod
    @abstractmethod
    def read(cls, arm: Arm, values: Mapping[str, Value], errors: ReadingErrors) -> ReadingErrors:
        """Return errors with those that checked values say of this effect.

        Raises:
            ConfigError: A reading from which nothing can be made out.
        """

    @classmethod
    @abstractmethod
    def written(cls, arm: Arm, errors: ReadingErrors) -> dict[str, Value]:
        """Return the values that :meth:`read` would take; none where it is not among the errors."""

    @classmethod
    def invalidates_commands(cls, arm: Arm, errors: ReadingErrors) -> bool:
        """Return whether a command that rests on the live readings would be wrong by it."""
        return bool(cls.written(arm, errors))


class FactorEffect(SensorEffect):
    """A factor on what is read of each joint.

    Class attributes:
        FACTORS: Name of the parameter that has them.
        FACTOR_OF: What it is a factor of, as :class:`ReadingErrors` calls it.
        FACTOR_MEANING: The same in words.
    """

    FACTORS: ClassVar[str]
    FACTOR_OF: ClassVar[str]
    FACTOR_MEANING: ClassVar[str]

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return (joint_array(arm, cls.FACTORS, "1", cls.FACTOR_MEANING),)

    @classmethod
    def read(cls, arm: Arm, values: Mapping[str, Value], errors: ReadingErrors) -> ReadingErrors:
        factors = as_array(values.get(cls.FACTORS), arm.n, 1.0)
        require_factors(arm, factors, cls.FACTORS)
        known: Array = getattr(errors, cls.FACTOR_OF)  # or a map, with a row for each reading
        by_row = factors[:, None] if known.ndim == 2 else factors
        changed: dict[str, Any] = {cls.FACTOR_OF: by_row * known}
        return replace(errors, **changed)

    @classmethod
    def written(cls, arm: Arm, errors: ReadingErrors) -> dict[str, Value]:
        values: Array = getattr(errors, cls.FACTOR_OF)
        factors = np.diag(values) if values.ndim == 2 else values
        mixes = values.ndim == 2 and not is_diagonal(values)
        return {} if mixes or (factors == 1.0).all() else {cls.FACTORS: as_value(factors)}


def require_factors(arm: Arm, factors: Array, name: str) -> None:
    """Raise ConfigError for one of (n,) factors that is none of a reading, whatever its sign."""
    beyond = (np.abs(factors) < 1.0 / _MOST) | (np.abs(factors) > _MOST)
    if beyond.any():
        joint = int(np.argmax(beyond))
        expected = f"a factor of {arm.joint_names[joint]} from {1.0 / _MOST:g} to {_MOST:g}"
        raise ConfigError(f"{name}[{joint}]", float(factors[joint]), expected)


def is_diagonal(values: Array) -> bool:
    """Return whether a (n, n) map mixes no joints."""
    return np.array_equal(values, np.diag(np.diag(values)))
