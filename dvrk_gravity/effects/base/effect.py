"""What every effect is, and what it is to suppose that one acts somewhere.

An effect has a name and words; a hypothesis of it has few columns of torque, and says what their
parameters would mean and how a model takes them in.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.evidence import Filtered, Motion, Residual
from dvrk_gravity.effects.base.meaning import Estimate, Meaning
from dvrk_gravity.effects.base.site import Kind, Site
from dvrk_gravity.errors import EffectError

Setting = Mapping[str, float]
Values = Mapping[str, Any]

# Of a model's friction: between all of it, which may be missing, and twice, which is what an effort
# of the wrong sign lacks. Chosen.
MOST_LESS = 1.5


class Effect(ABC):
    """One named cause of torque, or fault of a reading.

    Class attributes:
        NAME: Its name in the vocabulary.
        TITLE: Its name as a person writes it; by default the same without underscores.
        NAMELESS: It stands for what no other effect explains, and is believed last.
        MEANINGS: Meanings of the parameters that findings report.
        REMEDY: What to do about it, in one line; ``{joint}`` is the first joint of a finding.
    """

    NAME: ClassVar[str]
    TITLE: ClassVar[str] = ""
    NAMELESS: ClassVar[bool] = False
    MEANINGS: ClassVar[Mapping[str, Meaning]] = {}
    REMEDY: ClassVar[str] = ""

    @classmethod
    def title(cls) -> str:
        """Return its name as a person writes it."""
        return cls.TITLE or cls.NAME.replace("_", " ")

    @classmethod
    def meaning(cls, name: str) -> Meaning:
        """Return the meaning of a parameter."""
        return cls.MEANINGS.get(name) or Meaning()

    @classmethod
    def listed(cls, names: Iterable[str]) -> list[str]:
        """Return which of a finding's parameters have a line in tables."""
        return [name for name in names if cls.meaning(name).listed]

    @classmethod
    def in_short(cls, parameters: Mapping[str, Estimate]) -> str:
        """Return a finding's sizes in a row of a table; ``""``: the first of those listed."""
        del parameters
        return ""

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Yield where it can be supposed in a motion, apart from what :meth:`search` finds."""
        del motion
        yield from ()

    @classmethod
    def search_basis(cls, data: Filtered) -> Any:
        """Return what :meth:`search` needs of the data, made once; it may be large."""
        del data

    @classmethod
    def search(cls, basis: Any, residual: Residual) -> Iterator[Hypothesis]:
        """Yield where it is seen in a residual."""
        del basis, residual
        yield from ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypothesis(ABC):
    """One effect at one site, linear in a few parameters at one setting of its non-linear ones.

    Class attributes:
        EFFECT: The effect.
        OF_ACTING: Its torque is a part of what acts, other causes' torque too: a reading of it.
        ERRORS_ADD: What a model misses looks like it at all joints in the same sense, so that the
            joints' errors add: friction that comes on over a way is late wherever it is.
        CLAIM: What is claimed, with ``{where}`` (the site), ``{joint}`` and ``{other}`` (the first
            and the second of :attr:`joints`), ``{model}`` (what it is compared with), and
            parameters in words by their names.

    Attributes:
        arm: The arm.
        site: Where it acts.
        joints: Indices of the joints that it is said of, the affected one first; empty for the arm.
        form: Which of several forms it has there; ``""`` if there is but one.
        setting: Non-linear parameters, by name.
        refine: Names of settings that may be refined by a continuous search.
        fixed_point: Names of settings whose best value is what :meth:`describe` returns under
            the same name: the columns are rebuilt there.
        far_from_start: At the settings that it begins with it may look like nothing, so that those
            are looked for before it is compared with others.
        edges: Names of settings that are times at which the torque jumps.
        variable: What the torque is a function of, for the picture: ``position``, ``velocity``,
            ``acceleration`` or ``time``.
        directed: The picture tells the directions of motion apart.
        searched: How many more hypotheses it stands for (the grid of a search), at least 1.
        plausible_size: (k,) standard deviations that parameters may have before any data; empty
            for claims, which no prior holds back.
        of_model: These are parameters that the model has already, which may move along beside
            other hypotheses; a claim of its own it is only in the last place.
        alignment: It is about where joints or base are, which few motions tell from one another.
        of_state: Its torque is a function of position, velocity and acceleration at one time.
        transient: It comes once, or changes with time: the same state at another time does not
            show the same.
        composite: It stands for causes at several joints that are alike: not where these, each with
            a size of its own (:attr:`freed`), explain more.
        shifts_positions: It changes what positions mean: merged into a model before others.
        removable: How much of it the model has, in its own unit: no more can be missing.
        beside_reference: Two recordings are compared, not one with the model. Set for all
            hypotheses at once, where their columns are built.
    """

    EFFECT: ClassVar[type[Effect]]
    OF_ACTING: ClassVar[bool] = False
    ERRORS_ADD: ClassVar[bool] = False
    CLAIM: ClassVar[str] = ""

    arm: Arm
    site: Site
    joints: tuple[int, ...] = ()
    form: str = ""
    setting: Setting = field(default_factory=dict)
    refine: tuple[str, ...] = ()
    fixed_point: tuple[str, ...] = ()
    far_from_start: bool = False
    edges: tuple[str, ...] = ()
    variable: str = "position"
    directed: bool = False
    searched: int = 1
    plausible_size: tuple[float, ...] = ()
    of_model: bool = False
    alignment: bool = False
    of_state: bool = True
    transient: bool = False
    composite: bool = False
    shifts_positions: bool = False
    removable: float = np.inf
    beside_reference: bool = False

    @abstractmethod
    def build(self, motion: Motion, setting: Setting) -> Array:
        """Return (N, n, k) columns of torque per unit of each parameter, at a setting."""

    @abstractmethod
    def describe(self, theta: Array, setting: Setting) -> dict[str, float]:
        """Return named values of (k,) parameters at a setting."""

    def slope(self, motion: Motion) -> Array | None:
        """Return (N, n, k) slopes of its torque by its parameters, at its setting.

        ``None``: those of what :meth:`build` returns, by finite differences.

        Args:
            motion: The motion with the model on trial.
        """
        return None

    @property
    def other_form(self) -> Hypothesis | None:
        """The same claim with columns of another form, the likelier of which is taken, if any."""
        return None

    def at_fit(self, theta: Array) -> Hypothesis:
        """Return it at the settings that (k,) parameters themselves tell (:attr:`fixed_point`)."""
        if not self.fixed_point:
            return self
        told = self.describe(theta, self.setting)
        return replace(
            self, setting={**self.setting, **{name: told[name] for name in self.fixed_point}}
        )

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        """Return a model's parameters with (k,) parameters of this put in.

        Args:
            values: The model's parameters; encoder zeros that were found are in.
            theta: Parameters, of columns that are functions of *measured* positions.
            motion: The motion that they were found in.

        Returns:
            The values, or ``None`` if a model file cannot carry it.
        """
        del values, theta, motion
        return None

    def taken_in(self, motion: Motion) -> float:
        """Return the variance of each parameter for what a model may have taken in unseen.

        What was there of it when the model was identified, and looked like the arm itself.
        """
        del motion
        return 0.0

    def acting_on(self, model: Any, theta: Array) -> Any:
        """Return a model as it is with (k,) parameters of this acting on its terms.

        For causes beside which the model's *own* parameters have other torques; ``None``: they
        have the same.

        Args:
            model: A :class:`dvrk_gravity.model.torque_model.TorqueModel`.
            theta: Parameters.
        """
        del model, theta
        return None

    def plausible(self, theta: Array) -> bool:
        """Tell whether (k,) such parameters are possible.

        A scale near zero, a friction that drives, a weight that lifts: a fit that asks for these
        has found something else.
        """
        for name, value in self.describe(theta, self.setting).items():
            meaning = self.EFFECT.meaning(name)
            if not meaning.least <= value <= meaning.greatest:
                return False
        return self.lessens(theta) <= MOST_LESS

    def lessens(self, theta: Array) -> float:
        """Return which part of the friction that the model has there (k,) parameters take away.

        Zero where they add to it, and beside a reference, of which it is not known.
        """
        less = max(-float(np.min(theta)), 0.0)
        if less == 0.0 or self.beside_reference:
            return 0.0
        return less / self.removable if self.removable > 0.0 else np.inf

    def search_range(self, name: str, motion: Motion) -> tuple[float, float]:
        """Return between which values a setting is refined."""
        del motion
        centre = self.setting[name]
        return 0.4 * centre, 2.5 * centre

    @property
    def freed(self) -> Hypothesis | None:
        """The claim with each parameter on its own, where this one takes some to be equal."""
        return None

    def must_show(self, motion: Motion) -> tuple[Hypothesis, ...]:
        """Return parts of a claim of one parameter, of which the first must show beside the others.

        Empty where there are none: then all of it is judged as a whole.
        """
        del motion
        return ()

    @property
    def judged_at(self) -> tuple[int, ...]:
        """Joints by whose error it is judged; empty for all that its torque acts on."""
        return () if self.site.kind is Kind.LINK else self.joints

    @property
    def depends_on(self) -> int | None:
        """Joint whose variable the torque is a function of; ``None``: the judged one's own."""
        return None

    @property
    def told_apart_by(self) -> str:
        """What recording would tell it from others, in words; ``""`` where poses do."""
        return ""

    @property
    def against(self) -> str:
        """What claims compare with, in words."""
        return compared_with(self.beside_reference)

    @property
    def effect(self) -> str:
        """Name in the vocabulary."""
        return self.EFFECT.NAME

    @property
    def place(self) -> str:
        """Form or site as findings name it."""
        return self.form or self.site.kind.value

    @property
    def key(self) -> tuple[str, tuple[int, ...], str]:
        """What it claims, its continuous settings apart."""
        return self.effect, self.joints, self.place

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(self.arm.joint_names[joint] for joint in self.joints)

    @property
    def subject(self) -> str:
        """What it would change, in words."""
        return f"{self.EFFECT.title()} of {self.site.words(self.arm)}"

    def unit(self, name: str) -> str:
        """Return the unit of a parameter at this site; a joint that slides has N and m."""
        return self.site.unit(self.arm, self.EFFECT.meaning(name).unit)

    def claim(self, parameters: Mapping[str, Estimate]) -> str:
        """Return what is claimed, with its size.

        Raises:
            EffectError: The claim names what is no parameter.
        """
        words = self.words(parameters) | self._told(parameters)
        try:
            return self.CLAIM.format(**words)
        except (LookupError, ValueError) as error:
            raise EffectError(
                self.effect, f"CLAIM {self.CLAIM!r}: {error}, expected of {', '.join(words)}"
            ) from error

    def correction(self) -> str:
        """Return what is done about it, as the subject of `removes … % of the error`."""
        return "correcting that"

    def remedy(self, carried: bool) -> str:
        """Return what to do about it, in one line.

        Args:
            carried: Whether the extended model carries it.
        """
        joint = self.names[0] if self.names else self.site.words(self.arm)
        return or_extended(self.EFFECT.REMEDY.format(joint=joint), carried)

    def words(self, parameters: Mapping[str, Estimate]) -> dict[str, str]:
        """Return what claims call site, joint and model."""
        del parameters
        joint, other, *_ = (*self.names, "", "")
        where = self.site.words(self.arm)
        return {"where": where, "joint": joint, "other": other, "model": self.against}

    def _told(self, parameters: Mapping[str, Estimate]) -> dict[str, str]:
        """Return the parameters in words."""
        return {name: self.meaning(name).tell(estimate) for name, estimate in parameters.items()}

    def meaning(self, name: str) -> Meaning:
        """Return the meaning of a parameter."""
        return self.EFFECT.meaning(name)

    def __str__(self) -> str:
        """Return the claim in short."""
        where = " and ".join(self.names) or "the arm"
        detail = "" if self.place in ("joint", "") else f" ({self.place})"
        return f"{self.effect} at {where}{detail}"


def or_extended(what: str, carried: bool) -> str:
    """Return what to do about a finding, or that the extended model has it, where that does."""
    model = "use the extended model, which has it" if carried else ""
    return "; or ".join(part for part in (what, model) if part)


def compared_with(reference: bool) -> str:
    """Return what a recording is compared with, in words: the model, or a reference."""
    return "the reference" if reference else "the model"


def spread(row: Array, *values: Array) -> Array:
    """Return (N, n, k) torques that (N,) values at a (n,) row of the joints mean at the joints."""
    return np.stack([value[:, None] * row for value in values], axis=2)
