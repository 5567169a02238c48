"""Static poses as arrays, and gravity's columns at them.

An MTM has the ten parameters of beta; any other arm the combinations of its links' masses and first
moments that act, each in units of what the links may weigh.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import gravity
from dvrk_gravity.arms import Arm, is_mtm, rigid_body
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import as_value, weight_directions, weight_of
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification.quality.identifiability import base_weights
from dvrk_gravity.observation import observe, require_measured, warnings_of
from dvrk_gravity.parameters import Value
from dvrk_gravity.recording import Coordinates, Note, Recording

LEAST = 2  # poses for each of gravity's parameters, of which an MTM has ten. Chosen
FEWEST = 20  # poses in any case. Chosen: four in each of the five blocks that are held out
# Range below which a joint was not posed, rad (10 mm where it slides). Chosen: 6 deg; one that was
# asked to stay is off by less.
POSED = 0.1
RARER = 0.1  # part of the poses that must have come from the rarer direction. Chosen
N_BETA = 10
# Prior size of links' parameters, in what the links of the arm's file weigh or are assumed to.
# Chosen: 1 N·m is two to five times the RMS of MTMR-28002's beta. With one, what poses determine
# poorly is shrunk too much: loads on a UR5 identified from 60 poses were 8 % too heavy
# (benchmark/poses.py).
LINKS = 3.0


@dataclass(frozen=True, eq=False)
class Poses:
    """Static poses in joint coordinates.

    Attributes:
        q: (N, n) rad or m.
        effort: (N, n) N·m or N.
        direction: (N, n) +1/-1; 0 where it is not known.
        part: (N,) index of the recording.
        scale: (n,) equivalent of a rad, by joint (``Arm.scale``).
    """

    q: Array
    effort: Array
    direction: Array
    part: NDArray[np.int64]
    scale: Array

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.q)

    def rows(self, selection: Mask) -> Poses:
        """Return the poses that a mask selects."""
        return replace(
            self,
            q=self.q[selection],
            effort=self.effort[selection],
            direction=self.direction[selection],
            part=self.part[selection],
        )

    @cached_property
    def lower(self) -> Array:
        """(n,) least position of each joint, rad or m."""
        return self.q.min(axis=0)

    @cached_property
    def upper(self) -> Array:
        """(n,) greatest position of each joint, rad or m."""
        return self.q.max(axis=0)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Joints that were posed differently."""
        return tuple(np.flatnonzero(self.upper - self.lower > POSED * self.scale).tolist())

    @property
    def undirected(self) -> tuple[int, ...]:
        """Joints whose friction the poses do not separate."""
        return tuple(joint for joint, separate in enumerate(self.directed) if not separate)

    @cached_property
    def directed(self) -> tuple[bool, ...]:
        """(n,) whether both directions occur often enough to separate friction from cable."""
        up, down = (self.direction > 0).mean(axis=0), (self.direction < 0).mean(axis=0)
        return tuple((np.minimum(up, down) >= RARER).tolist())


def read_poses(
    recordings: Sequence[Recording], arm: Arm, coordinates: Coordinates
) -> tuple[Poses, tuple[Note, ...]]:
    """Return the poses of some recordings, and warnings about them.

    Raises:
        RecordingError: A joint or the efforts missing, too few poses, or nothing that moves.
    """
    observed = observe(recordings, arm, decide=lambda number, prepared: coordinates)
    for each in observed:
        posed = np.ptp(each.q, axis=0) > POSED * arm.scale
        moved = [joint for joint, moves in zip(arm.joint_names, posed, strict=True) if moves]
        require_measured(each.sources[0], moved, each.effort[:, posed])
    poses = Poses(
        np.concatenate([each.q for each in observed]),
        np.concatenate([each.effort for each in observed]),
        np.concatenate(
            [np.zeros(each.q.shape) if each.direction is None else each.direction
             for each in observed]
        ),
        np.concatenate([np.full(len(each), index) for index, each in enumerate(observed)]),
        arm.scale,
    )  # fmt: skip
    least = max(FEWEST, LEAST * gravity_of(arm).count)
    if len(poses) < least:
        raise RecordingError(
            recordings[0].source, f"holds {len(poses)} static poses, expected at least {least}"
        )
    return poses, warnings_of(observed)


@dataclass(frozen=True, eq=False)
class GravityColumns(ABC):
    """Gravity's part of the torques at static poses, linear in k coefficients.

    Attributes:
        arm: The arm, its base as it is mounted.
        sprung: Joints with a spring or counterweight that pulls like a weight, and is no link's.
        bounded: Whether predictions are limited to the torques that the poses showed.
    """

    arm: Arm
    sprung: tuple[str, ...] = ()
    bounded: bool = False

    @property
    @abstractmethod
    def count(self) -> int:
        """Number k of coefficients, each of the order of one before any data."""

    @property
    @abstractmethod
    def strong(self) -> Array:
        """(n,) torques larger than any joint's friction or cable, N·m or N."""

    @abstractmethod
    def at(self, q: Array) -> Array:
        """Return (N, n, k) joint torques of the coefficients at (N, n) positions."""

    @abstractmethod
    def quantities(self) -> tuple[tuple[str, str, Array], ...]:
        """Return name, unit and (k,) combination of the coefficients of each reported parameter."""

    @abstractmethod
    def parameters(self, theta: Array) -> Mapping[str, Value]:
        """Return the parameters of a model that has (k,) coefficients."""


class BetaColumns(GravityColumns):
    """An MTM's: beta in N·m."""

    @property
    def count(self) -> int:
        """Entries of beta."""
        return N_BETA

    @property
    def strong(self) -> Array:
        """1 N·m."""
        return np.ones(self.arm.n)

    def at(self, q: Array) -> Array:
        """Return the regressor of beta."""
        return gravity.regressor(q, self.arm.gravity, N_BETA)

    def quantities(self) -> tuple[tuple[str, str, Array], ...]:
        """Return the entries of beta."""
        unit = self.arm.own_unit("N·m")
        return tuple(
            (f"beta{k + 1} ({gravity.BETA_NAMES[k]})", unit, row)
            for k, row in enumerate(np.eye(N_BETA))
        )

    def parameters(self, theta: Array) -> Mapping[str, Value]:
        """Return beta, and gravity's direction."""
        return {"beta": as_value(theta), "gravity_vector": as_value(self.arm.gravity)}


class LinkColumns(GravityColumns):
    """Any other arm's: combinations of its links' weights, of unit prior size."""

    @cached_property
    def _directions(self) -> Array:
        """(4 bodies, k) from the coefficients to the links' masses and first moments."""
        return LINKS * weight_directions(self.arm)

    @property
    def count(self) -> int:
        """Combinations that act."""
        return self._directions.shape[1]

    @property
    def strong(self) -> Array:
        """What its motors can do at most."""
        return self.arm.effort_limit

    def at(self, q: Array) -> Array:
        """Return the regressor of the combinations."""
        return rigid_body.weight_regressor(self.arm, q, self.arm.gravity) @ self._directions

    def quantities(self) -> tuple[tuple[str, str, Array], ...]:
        """Return the base parameters that act at rest."""
        return tuple(
            (name, self.arm.own_unit(unit), combination @ self._directions)
            for name, unit, combination in base_weights(self.arm)
        )

    def parameters(self, theta: Array) -> Mapping[str, Value]:
        """Return the links' masses and first moments."""
        links = (self._directions @ theta).reshape(-1, rigid_body.OF_WEIGHT)
        return weight_of(self.arm, links).parameters()


def gravity_of(arm: Arm) -> GravityColumns:
    """Return gravity's columns of an arm.

    An MTM's beta compensates for cables, and is no link's weight: predictions are bounded.
    """
    if is_mtm(arm):
        return BetaColumns(arm, sprung=("wrist_pitch",), bounded=True)
    return LinkColumns(arm)
