"""Fourier series from rest to rest, with exact derivatives and proven bounds of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import comb

import numpy as np

from dvrk_gravity.arrays import Array

# Largest values of the step 10 s^3 - 15 s^4 + 6 s^5 and of its first four derivatives on [0, 1].
RISE_BOUNDS = (1.0, 1.875, 10.0 / np.sqrt(3.0), 60.0, 360.0)
RISE = np.polynomial.Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])


@dataclass(frozen=True, eq=False)
class Basis:
    """What the series of a motion are sums of: w(t) cos(2 pi f_k t), then w(t) sin(2 pi f_k t).

    The window w rises from 0 to 1 within the ramp, with velocity and acceleration zero at both of
    its ends, and falls likewise: a motion is linear in its coefficients, and at rest at its ends.

    Attributes:
        frequency: (k,) Hz.
        ramp: s.
        duration: s.
    """

    frequency: Array
    ramp: float
    duration: float

    def at(self, time: Array, derivatives: int = 2) -> Array:
        """Return (derivatives + 1, N, 2 k) values and derivatives by time at (N,) times, s."""
        time = np.asarray(time, dtype=float)
        omega = 2.0 * np.pi * self.frequency
        angle = time[:, None] * omega
        cosine, sine = np.cos(angle), np.sin(angle)
        # (cos, sin) and their derivatives: each is the last times omega, a quarter turn on.
        waves = [np.hstack([cosine, sine])]
        for _ in range(derivatives):
            cosine, sine = -omega * sine, omega * cosine
            waves.append(np.hstack([cosine, sine]))
        window = self._window(time, derivatives)
        return np.array(
            [
                sum(comb(d, j) * window[j][:, None] * waves[d - j] for j in range(d + 1))
                for d in range(derivatives + 1)
            ]
        )

    def _window(self, time: Array, derivatives: int) -> list[Array]:
        """Return (N,) window and its derivatives by time."""
        into, out = time / self.ramp, (self.duration - time) / self.ramp
        rising = into < out
        s = np.clip(np.where(rising, into, out), 0.0, 1.0)
        inside = (s > 0.0) & (s < 1.0)
        found = [RISE(s)]
        for d in range(1, derivatives + 1):
            sign = np.where(rising, 1.0, (-1.0) ** d)
            found.append(np.where(inside, sign * RISE.deriv(d)(s), 0.0) / self.ramp**d)
        return found

    def bounds(self, derivative: int) -> tuple[Array, Array]:
        """Return what multiplies (k,) amplitudes to a bound of a derivative, (k,) each.

        First within the ramps, by the product rule, then between them, where the window is 1.
        """
        omega = 2.0 * np.pi * self.frequency
        within = sum(
            comb(derivative, j) * RISE_BOUNDS[j] / self.ramp**j * omega ** (derivative - j)
            for j in range(derivative + 1)
        )
        return np.asarray(within), omega**derivative

    def grid(self, step: float) -> tuple[Array, Array]:
        """Return times at most ``step`` apart, both ends of the ramps among them.

        Returns:
            (N,) times, s, and (N - 1,) whether the interval after each lies within a ramp.
        """
        corners = (0.0, self.ramp, self.duration - self.ramp, self.duration)
        parts, within = [np.zeros(1)], []
        for k, (begin, end) in enumerate(pairwise(corners)):
            if end > begin:
                count = int(np.ceil((end - begin) / step - 1e-9))
                parts.append(begin + (end - begin) * np.arange(1, count + 1) / count)
                within.append(np.full(count, k != 1))
        return np.concatenate(parts), np.concatenate(within)


@dataclass(frozen=True, eq=False)
class FourierMotion:
    """q(t) = middle + w(t) sum_k (a_k cos(2 pi f_k t) + b_k sin(2 pi f_k t)).

    Attributes:
        basis: Window and waves.
        middle: (n,) where it begins and ends, rad or m.
        coefficients: (2 k, n) a, then b.
    """

    basis: Basis
    middle: Array
    coefficients: Array

    @classmethod
    def of_sines(
        cls, middle: Array, amplitude: Array, frequency: Array, phase: Array, ramp: float,
        duration: float,
    ) -> FourierMotion:  # fmt: skip
        """Return middle + w(t) sum_k a_k sin(2 pi f_k t + phi_k), where each joint has its own f.

        Args:
            middle: (n,) rad or m.
            amplitude: (k, n) likewise.
            frequency: (k, n) Hz.
            phase: (k, n) rad.
            ramp: s.
            duration: s.
        """
        different, which = np.unique(frequency, return_inverse=True)
        which, joint = which.reshape(frequency.shape), np.arange(len(middle))
        cosine, sine = np.zeros((2, len(different), len(middle)))
        np.add.at(cosine, (which, joint), amplitude * np.sin(phase))
        np.add.at(sine, (which, joint), amplitude * np.cos(phase))
        return cls(Basis(different, ramp, duration), middle, np.vstack([cosine, sine]))

    @property
    def duration(self) -> float:
        """When it is at rest again, s."""
        return self.basis.duration

    @cached_property
    def amplitude(self) -> Array:
        """(k, n) amplitudes of the waves."""
        cosine, sine = np.split(self.coefficients, 2)
        return np.asarray(np.hypot(cosine, sine))

    def at(self, time: float | Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, (n,) each, or (N, n) for (N,) times."""
        moment = np.clip(np.atleast_1d(np.asarray(time, dtype=float)), 0.0, self.duration)
        q, qd, qdd = self.basis.at(moment) @ self.coefficients
        q = q + self.middle
        return (q, qd, qdd) if np.ndim(time) else (q[0], qd[0], qdd[0])

    def bound(self, derivative: int, rows: Array, within_ramp: bool) -> Array:
        """Return (r,) what a derivative of r combinations of the joints never exceeds.

        Args:
            derivative: Its order, at least 1.
            rows: (r, n) factors of the joints.
            within_ramp: Whether within the ramps, or between them.
        """
        weight = self.basis.bounds(derivative)[0 if within_ramp else 1]
        cosine, sine = np.split(self.coefficients @ rows.T, 2)
        return np.asarray(weight @ np.hypot(cosine, sine))

    def grid(self, step: float, rows: Array) -> tuple[Array, Array]:
        """Return times, and by how much values beside each may exceed those there.

        A function f with |f''| <= M is between two points h apart no greater than the greater of
        both values plus M h^2 / 8.

        Args:
            step: Greatest distance of two times, s.
            rows: (r, n) factors of the joints.

        Returns:
            (N,) s, and (3, N, r) for combinations of positions, velocities and accelerations.
        """
        time, within = self.basis.grid(step)
        # A point has an interval on either side.
        either = np.append(within, within[-1:]) | np.concatenate([within[:1], within])
        extra = [
            np.where(either[:, None], *(self.bound(order, rows, ramp) for ramp in (True, False)))
            for order in (2, 3, 4)
        ]
        return time, np.array(extra) * step**2 / 8.0

    def scaled(self, about: Array, factor: float | Array) -> FourierMotion:
        """Return the motion moved towards (n,) positions: to one or (n,) ``factor`` of it."""
        middle = about + factor * (self.middle - about)
        return FourierMotion(self.basis, middle, factor * self.coefficients)
