"""Uncertainty of a model: its parameters' posterior, and the error that it never explained.

Both come from the recordings that it was identified from, and lie in a file beside the model's,
which names it: every torque that a model predicts is tau + T u + e, with T the change of torque by
independent changes of the parameters of one standard deviation each, u ~ N(0, 1), and e the error
that stayed on data which the fit had not seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Joint
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import LinearTerm, State, Term
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import array_file
from dvrk_gravity.model.calibration_samples import CalibrationSamples

SUFFIX = ".uncertainty.npz"
_SAME = 1e-6  # relative, by which a number that went through a text file may differ
# In the file, and here.
_BY_JOINT = {
    "error": "error",
    "together": "correlation_time",
    "lower": "lower",
    "upper": "upper",
    "speed": "speed",
}
_MAY_BE_UNKNOWN = ("error", "together", "speed")  # of what was not measured, or of poses
_TURN = 1e-4  # m/s^2, of differences by the direction of gravity, in which weight is linear


@dataclass(frozen=True)
class OutsideSettings:
    """When a recording counts as beyond the range that a model was identified on.

    Attributes:
        share: Part of the samples, below which nothing is said of it. Chosen.
    """

    share: float = 0.02


@dataclass(frozen=True, eq=False)
class ModelUncertainty:
    """The posterior of a model's parameters, and its known error.

    Attributes:
        coefficients: By term, its (k,) coefficients that the posterior is about.
        deviations: By term, (k, d) changes of its coefficients in each of d directions: independent
            ones, of one standard deviation each. Those that data leave open are there with their
            prior.
        offset: (n, d) changes of the joints' zeros, rad.
        gravity: (3, d) changes of gravity in the base frame, m/s^2.
        error: (n,) RMS of the error on data that the fit had not seen, in joint space, N·m; NaN
            where it is not known.
        band: Hz; that error is what is left below this; NaN of static poses.
        correlation_time: (n,) s, the residual's correlation time; NaN likewise, as speed.
        lower: (n,) least true position that it was identified on.
        upper: (n,) greatest one.
        speed: (n,) greatest speed.
        calibration: What it was identified on, of which the error is what stays; ``None`` where
            that is not kept: of poses, and of models that were not allowed all terms.
        identity: Of the model in whose file's name it was written; ``""``: by an older version.
    """

    coefficients: Mapping[str, Array]
    deviations: Mapping[str, Array]
    offset: Array
    gravity: Array
    error: Array
    band: float
    correlation_time: Array
    lower: Array
    upper: Array
    speed: Array
    calibration: CalibrationSamples | None = None
    identity: str = ""

    @property
    def size(self) -> int:
        """Number of directions."""
        return int(self.offset.shape[1])

    def torque(self, terms: Iterable[Term], state: State) -> Array:
        """Return (N, n, d) changes of torque in each direction, at (N, n) *true* states.

        The joints' zeros are left to who knows the slope of the torque by position.
        """
        total = np.zeros((*state.q.shape, self.size))
        for term in terms:
            if term.NAME in self.deviations and isinstance(term, LinearTerm):
                memory = term.memory(state)
                # One product of all samples: of stacks, `@` is a product for each sample.
                total += np.tensordot(term.columns(state, memory), self.deviations[term.NAME], 1)
            vector = term.gravity_vector
            if vector is not None and self.gravity.any():
                here = term.torque(State(state.q))
                for axis in range(3):
                    if self.gravity[axis].any():
                        turned = term.with_gravity(vector + _TURN * np.eye(3)[axis])
                        slope = (turned.torque(State(state.q)) - here) / _TURN
                        total += slope[..., None] * self.gravity[axis]
        return total

    def extended_to(self, terms: Iterable[Term]) -> ModelUncertainty:
        """Return the same about terms some of which have gained coefficients, which come last.

        Nothing is said of those: beta has two more of a base that leans.
        """
        deviations = dict(self.deviations)
        for name, theta in coefficients_of(terms).items():
            change = deviations.get(name)
            if change is not None and len(theta) > len(change):
                deviations[name] = np.pad(change, ((0, len(theta) - len(change)), (0, 0)))
        return replace(self, deviations=deviations)

    def shift_terms(self, terms: Iterable[Term], parameters: Array) -> tuple[Term, ...]:
        """Return terms with (d,) parameters, in units of their standard deviations, put in.

        The joints' zeros are left to who has them; of a term that no longer has the coefficients
        that this is about, they stay.
        """
        result = []
        for term in terms:
            change = self.deviations.get(term.NAME)
            if (
                isinstance(term, LinearTerm)
                and change is not None
                and len(term.theta) == len(change)
            ):
                term = term.with_theta(term.theta + change @ parameters)
            if self.gravity.any() and term.gravity_vector is not None:
                term = term.with_gravity(term.gravity_vector + self.gravity @ parameters)
            result.append(term)
        return tuple(result)

    def fits(self, terms: Iterable[Term]) -> bool:
        """Return whether terms have the posterior's coefficients."""
        known = coefficients_of(terms)
        return all(
            name in known
            and known[name].shape == theta.shape
            and np.allclose(known[name], theta, rtol=_SAME, atol=_SAME * np.abs(theta).max())
            for name, theta in self.coefficients.items()
        )

    def outside(
        self,
        joints: Sequence[Joint],
        q: Array,
        qd: Array | None,
        present: NDArray[np.bool_],
        settings: OutsideSettings | None = None,
    ) -> Iterator[str]:
        """Yield where (N, n) *true* positions and speeds lie outside what it was identified on.

        Args:
            joints: The n joints.
            q: Positions, rad or m.
            qd: Velocities, rad/s or m/s; ``None`` of poses.
            present: (n,) joints that were recorded; nothing is said of others.
            settings: How many samples count.
        """
        least = (settings or OutsideSettings()).share
        of = "the poses" if qd is None else "the time"
        for k in np.flatnonzero(present).tolist():
            joint = joints[k]
            low, high, fastest = (float(each[k]) for each in (self.lower, self.upper, self.speed))
            beyond = float(np.mean((q[:, k] < low) | (q[:, k] > high)))
            if beyond > least:
                span = f"{joint.shown(low).split()[0]} to {joint.shown(high)}"
                share = f"{100 * beyond:.0f} % of {of}"
                yield f"{joint.name} is outside the identified {span} for {share}"
            # Of poses the speed is not known: NaN, which nothing is beyond.
            faster = 0.0 if qd is None else float(np.mean(np.abs(qd[:, k]) > fastest))
            if faster > least:
                share = f"{100 * faster:.0f} % of {of}"
                limit = f"{joint.shown(fastest)}/s"
                yield f"{joint.name} is faster than the identified {limit} for {share}"

    def save(self, path: Path, identity: str) -> None:
        """Write the file, whole or not at all, as that of a model's identity.

        Raises:
            OSError: It cannot be written.
        """
        arrays: dict[str, Any] = {
            "offset": self.offset, "gravity": self.gravity, "error": self.error,
            "band": np.array(self.band), "together": self.correlation_time, "lower": self.lower,
            "upper": self.upper, "speed": self.speed,
        }  # fmt: skip
        arrays["identity"] = np.frombuffer(identity.encode(), np.uint8).astype(float)
        for name, theta in self.coefficients.items():
            arrays[f"coefficients/{name}"] = theta
            arrays[f"deviations/{name}"] = self.deviations[name]
        if self.calibration is not None:
            for name, array in self.calibration.arrays().items():
                arrays[f"calibration/{name}"] = array
        array_file.write(path, arrays)

    @classmethod
    def load(cls, path: Path) -> ModelUncertainty:
        """Read the file.

        Raises:
            ConfigError: Naming the file, if it is not such a one.
        """
        arrays = array_file.load(path)
        try:
            named = {
                kind: {
                    name.removeprefix(f"{kind}/"): array
                    for name, array in arrays.items()
                    if name.startswith(f"{kind}/")
                }
                for kind in ("coefficients", "deviations", "calibration")
            }
            found = cls(
                named["coefficients"], named["deviations"], arrays["offset"], arrays["gravity"],
                arrays["error"], float(arrays["band"]), arrays["together"], arrays["lower"],
                arrays["upper"], arrays["speed"],
                identity=_text(arrays.get("identity", np.empty(0))),
            )  # fmt: skip
        except (KeyError, TypeError, ValueError) as error:
            raise _unusable(path, f"an uncertainty file written by identify ({error})") from error
        found._check(path)
        kept = named["calibration"]
        if not kept:
            return found
        try:
            samples = CalibrationSamples.from_arrays(kept, len(found.offset), found.band)
        except KeyError as error:
            raise _unusable(path, f"an array calibration/{error.args[0]}") from error
        except (TypeError, ValueError) as error:
            raise _unusable(path, str(error)) from error
        return replace(found, calibration=samples)

    def _check(self, path: Path) -> None:
        if self.offset.ndim != 2:
            raise _unusable(path, "offset of shape (joints, directions)")
        shapes = {
            **{
                f"deviations of {n}": (*t.shape[:1], self.size)
                for n, t in self.coefficients.items()
            },
            "gravity": (3, self.size),
            "offset": self.offset.shape,
            **{name: (len(self.offset),) for name in _BY_JOINT},
        }
        arrays = {
            **{f"deviations of {n}": self.deviations.get(n) for n in self.coefficients},
            "gravity": self.gravity,
            "offset": self.offset,
            **{name: getattr(self, field) for name, field in _BY_JOINT.items()},
        }
        alone = set(self.deviations) - set(self.coefficients)
        if alone:
            raise _unusable(path, f"coefficients of {min(alone)}, of which there are deviations")
        for name, shape in shapes.items():
            array = arrays[name]
            if array is None or array.shape != shape:
                raise _unusable(path, f"{name} of shape {shape}")
            if name not in _MAY_BE_UNKNOWN and not np.isfinite(array).all():
                raise _unusable(path, f"finite {name}")
            if name in _MAY_BE_UNKNOWN and (array < 0.0).any():
                raise _unusable(path, f"{name} of at least 0")
            if np.isinf(array).any():
                raise _unusable(path, f"finite {name}, or NaN where it is not known")
        if self.band <= 0.0 or np.isinf(self.band):
            raise _unusable(path, "finite band above 0, or NaN of poses")
        if (self.lower > self.upper).any():
            raise _unusable(path, "lower no greater than upper")


def coefficients_of(terms: Iterable[Term]) -> dict[str, Array]:
    """Return the (k,) coefficients of each term that is linear in them, by its name."""
    return {term.NAME: term.theta for term in terms if isinstance(term, LinearTerm)}


def _text(codes: Array) -> str:
    return codes.astype(np.uint8).tobytes().decode("ascii")


def _unusable(path: Path, expected: str) -> ConfigError:
    return ConfigError("uncertainty", path.name, expected).in_file(path)
