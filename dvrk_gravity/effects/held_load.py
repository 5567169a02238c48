"""Load that stiction holds at a joint which stands still while other joints are posed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import as_value, numbers, read_rows, write_rows
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.polynomials import Range, declare_range
from dvrk_gravity.effects.base.term import PlantPart, Term
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

MAX_ORDER = 12
_KINDS = ("mean", "difference")


@dataclass(frozen=True, eq=False)
class HeldLoad(Term):
    """tau_j = sum_k (mean_kj + direction_j difference_kj) f_k(q), a smooth function of the pose.

    While the wrist is posed, shoulder and elbow stand still, and their stiction takes a part of
    the change of load on itself: measured efforts are off by what the last motions left there,
    which depends on the whole pose and not on the joint's own position alone. The functions are
    products f_k = prod_i T_(orders[k, i])(x_i) of Chebyshev polynomials, x_i going from -1 to 1
    over the range in which joint i was posed and held at its edges, so that |f_k| <= 1 at
    every pose.

    It belongs to poses that were approached and held. Where a velocity is known and no direction
    of approach, it is zero, and the compensator never applies it.

    Attributes:
        arm: The arm, for its joints' names.
        orders: (K, n) order of each joint's polynomial in each function.
        mean: (K, n) N·m, whichever way the pose was approached.
        difference: (K, n) N·m along the direction in which the joint came.
        valid: Range of positions that were posed.
    """

    NAME = "held_load"
    AT_POSES = True
    COMPENSATED = False

    arm: Arm
    orders: NDArray[np.int64]
    mean: Array
    difference: Array
    valid: Range

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return (
            Parameter(
                f"{cls.NAME}.orders", (), "order",
                "order of each joint's Chebyshev polynomial, function by function",
                lower=0.0, upper=float(MAX_ORDER),
            ),
            *(
                Parameter(
                    f"{cls.NAME}.{kind}.{joint.name}", (), joint.effort_unit,
                    f"{text} of each function, {joint.name}",
                )
                for kind, text in (
                    ("mean", "size, either way"),
                    ("difference", "size, along the approach"),
                )
                for joint in arm.joints
            ),
            *declare_range(arm, cls.NAME),
        )  # fmt: skip

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> HeldLoad | None:
        flat = np.array(numbers(values, f"{cls.NAME}.orders"))
        if not len(flat):
            return None
        n = arm.n
        if len(flat) % n or (flat != np.round(flat)).any():
            raise ConfigError(
                f"{cls.NAME}.orders",
                values[f"{cls.NAME}.orders"],
                f"whole numbers, {n} for each function",
            )
        orders = flat.astype(np.int64).reshape(-1, n)
        expected = f"{len(orders)}, one for each function in {cls.NAME}.orders"
        sizes = {
            kind: read_rows(arm, values, f"{cls.NAME}.{kind}", len(orders), expected)
            for kind in _KINDS
        }
        valid = Range.from_parameters(arm, cls.NAME, values)
        used = orders.any(axis=0)
        for column in np.flatnonzero(used & ~np.isfinite(valid.upper - valid.lower)).tolist():
            raise ConfigError(
                f"{cls.NAME}.valid_lower of {arm.joint_names[column]}",
                None,
                "a range that has edges",
            )
        return cls(arm, orders, **sizes, valid=valid)

    def parameters(self) -> dict[str, Value]:
        mean, difference = (
            write_rows(self.arm, f"{self.NAME}.{kind}", getattr(self, kind)) for kind in _KINDS
        )
        orders = as_value(self.orders.astype(float).ravel())
        return (
            {f"{self.NAME}.orders": orders} | mean | difference | self.valid.parameters(self.NAME)
        )

    @property
    def fitted_range(self) -> Range:
        return self.valid

    def torque(self, state: State) -> Array:
        """Return (…, n) torques, N·m: both parts, the mean, or zero, by what is known."""
        if state.direction is None and state.qd is not None:
            return np.zeros(state.q.shape)
        functions = pose_functions(state.q, self.orders, self.valid)
        torque = functions @ self.mean
        if state.direction is not None:
            torque += state.direction * (functions @ self.difference)
        return torque

    def plant(self) -> PlantPart:
        """Nothing: the plant has its own stiction."""
        return PlantPart()


def pose_functions(q: Array, orders: NDArray[np.int64], valid: Range) -> Array:
    """Return (…, K) products of Chebyshev polynomials of (K, n) orders at (…, n) positions."""
    used = orders.any(axis=0)
    centre = np.where(used, 0.5 * (valid.lower + valid.upper), 0.0)
    half = np.where(used, 0.5 * (valid.upper - valid.lower), 1.0)
    # A joint that never moved has no width: its polynomials are those of zero.
    scaled = (valid.hold(q) - centre) / np.where(half > 0.0, half, 1.0)
    product = np.ones((*q.shape[:-1], len(orders)))
    for joint in np.flatnonzero(used).tolist():
        table = chebyshev.chebvander(scaled[..., joint], int(orders[:, joint].max()))
        # NumPy's table of one pose has a first axis of one.
        product *= table[..., orders[:, joint]].reshape(product.shape)
    return product
