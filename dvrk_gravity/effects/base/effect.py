"""What an effect is, and a hypothesis: that it acts at one site of an arm.

A minimal effect is a class with a ``NAME`` that yields hypotheses, and a hypothesis with two
methods: :meth:`Hypothesis.regressor`, the torque that it adds per unit of each parameter, and
:meth:`Hypothesis.parameters`, what fitted parameters mean. ``thermal_drift.py`` is an example.
Everything else here has a default.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values
from dvrk_gravity.effects.base.column import Column
from dvrk_gravity.effects.base.meaning import Estimate, Meaning, Words
from dvrk_gravity.effects.base.motion import Filtered, Motion, Residual
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.site import Kind, Site
from dvrk_gravity.errors import EffectError

MAX_REMOVED = 1.5
"""Largest fraction of the model's friction that may be missing.

Between all of it, 1, and twice, 2, which is what an effort of the wrong sign lacks. Chosen.
"""


class Effect(ABC):
    """One named cause of torque, or fault of a sensor.

    Class attributes:
        NAME: Its name in the vocabulary.
        TITLE: Its name in reports; by default ``NAME`` without underscores.
        UNEXPLAINED: It stands for structure that no other effect explains, and ranks last.
        MEANINGS: Unit, neutral value and words of each reported parameter.
        REMEDY: What to do about it, in one line; ``{joint}`` is the first joint of a finding.
        READS_WRONGLY: It is a fault of readings, of which a model may know (``reading.*``).
        IN_FILES: Formats of others whose files have a place for it, ``console`` (of the dVRK),
            ``urdf`` and ``mjcf``: a model that is fitted for one may have it.
    """

    NAME: ClassVar[str]
    TITLE: ClassVar[str] = ""
    UNEXPLAINED: ClassVar[bool] = False
    MEANINGS: ClassVar[Mapping[str, Meaning]] = {}
    REMEDY: ClassVar[str] = ""
    READS_WRONGLY: ClassVar[bool] = False
    IN_FILES: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def title(cls) -> str:
        """Return its name for reports."""
        return cls.TITLE or cls.NAME.replace("_", " ")

    @classmethod
    def meaning(cls, name: str) -> Meaning:
        """Return the meaning of a parameter."""
        return cls.MEANINGS.get(name) or Meaning()

    @classmethod
    def listed(cls, names: Iterable[str]) -> list[str]:
        """Return which of a finding's parameters get a line in tables; by default all."""
        return list(names)

    @classmethod
    def summary(cls, parameters: Mapping[str, Estimate]) -> str:
        """Return a finding's sizes for one row of a table; ``""``: the first listed ones."""
        return ""

    @classmethod
    def kinematic_columns(cls, arm: Arm) -> tuple[Column, ...]:
        """Return a fit's columns of what displaces joints or the base, per rad or m.

        Torque is not linear in them: a fit takes slopes about where it assumes them.
        """
        return ()

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Yield one hypothesis for each site and form at which the motion could show it."""
        yield from ()

    @classmethod
    def unit_changes(cls, motion: Motion) -> Iterator[tuple[Hypothesis, Array]]:
        """Yield changes of size one, with their (k,) parameters, that a user asks about.

        A diagnosis states which multiple of each it would have found; of several at one site, in
        other directions, the largest.
        """
        yield from ()

    @classmethod
    def history_hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Yield the hypotheses that an arm's history follows, of one form in every recording.

        By default what :meth:`unit_changes` asks about, each hypothesis once.
        """
        seen = list[Hypothesis]()
        for hypothesis, _ in cls.unit_changes(motion):
            if not any(hypothesis is each for each in seen):
                seen.append(hypothesis)
                yield hypothesis

    @classmethod
    def monitor_hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Yield the hypotheses that a monitor tests while an arm moves.

        By default what :meth:`history_hypotheses` follows.
        """
        yield from cls.history_hypotheses(motion)

    @classmethod
    def search_basis(cls, data: Filtered) -> Any:
        """Return what :meth:`search` needs of the data, computed once; it may be large."""
        return None

    @classmethod
    def search(cls, basis: Any, residual: Residual) -> Iterator[Hypothesis]:
        """Yield the hypotheses that a residual suggests, where a grid of them would be too long."""
        yield from ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypothesis(ABC):
    """One effect at one site: its torque is linear in k parameters theta.

    At sample i it adds ``tau_i = Z_i(setting) theta`` to the model's torque, with Z of shape
    (N, n, k) from :meth:`regressor`; parameters that are not linear are in :attr:`setting`.

    Class attributes:
        EFFECT: The effect.
        CLAIM: The sentence of a finding, with ``{where}`` (the site), ``{joint}`` and ``{other}``
            (the first two of :attr:`joints`), ``{form}``, ``{model}`` (what the data are compared
            with), and parameters in words by their names.
        EFFORT_READING: A fault of the effort reading: its torque is a function of all torque that
            acts, other causes' included.
        COHERENT_ERRORS: What a model misses resembles it at all joints with the same sign, so that
            errors add over joints: presliding resembles a delay, whatever the joint.
        EXPLAINED_BY: Effect that is named in its place where that explains as well and is
            :meth:`typical`: something displaces a centre of mass, and loads change more often than
            cables.
        STATED: It is known to be there: fitted from the start, and reported whatever its size.

    Attributes:
        arm: The arm.
        site: Where it acts.
        joints: Indices of the joints that a finding names, the affected one first; by default the
            site's own, and none of base and arm.
        form: Which of several forms at that site; ``""`` if there is one.
        setting: Non-linear parameters, by name.
        prior_std: (k,) prior standard deviations of the parameters; empty: no prior.
        removable: How much of it the model has, in its own unit: no more can be missing.
        against_reference: Two recordings are compared, not one with the model. Set for all
            hypotheses at once, where their columns are built.
        reads_others: Of an effort reading: its columns have the torque of other causes, too.
    """

    EFFECT: ClassVar[type[Effect]]
    CLAIM: ClassVar[str] = ""
    EFFORT_READING: ClassVar[bool] = False
    COHERENT_ERRORS: ClassVar[bool] = False
    EXPLAINED_BY: ClassVar[str] = ""
    STATED: ClassVar[bool] = False

    arm: Arm
    site: Site
    joints: tuple[int, ...] = ()
    form: str = ""
    setting: Mapping[str, float] = field(default_factory=dict)
    prior_std: tuple[float, ...] = ()
    removable: float = np.inf
    against_reference: bool = False
    reads_others: bool = False

    def __post_init__(self) -> None:
        """Set the joints of the site, unless others are given."""
        if not self.joints:
            object.__setattr__(self, "joints", self.site.joints(self.arm))

    @abstractmethod
    def regressor(self, motion: Motion) -> Array:
        """Return Z, (N, n, k): torque at each joint per unit of each parameter.

        ``tau = Z theta`` in N·m (N where a joint slides) at the motion's N samples, unfiltered,
        with the sign of a torque that the actuators apply. It depends on :attr:`setting`, and must
        be finite. A torque g(q; p) that is not linear in p is given as a secant at the last
        estimate, (g(q; p) - g(q; 0)) / p, with p in :attr:`fixed_point`. :func:`spread` builds Z
        from functions of a joint's or motor's motion.

        Args:
            motion: N samples of the arm, with the model under test.
        """

    @abstractmethod
    def parameters(self, theta: Array) -> dict[str, float]:
        """Return the named parameters of (k,) theta, with the settings that are reported.

        The names are those of ``EFFECT.MEANINGS``, which has their units: SI, on a joint that
        turns. The function should be smooth: intervals are propagated through it.
        """

    # Its traits: class attributes of a subclass, or properties where they depend on the site.
    @property
    def refine(self) -> tuple[str, ...]:
        """Settings to optimise by a bounded search, see :meth:`search_range`."""
        return ()

    @property
    def refine_first(self) -> bool:
        """Optimise the settings before comparing: at the initial ones its torque may vanish."""
        return False

    @property
    def fixed_point(self) -> tuple[str, ...]:
        """Settings that :meth:`parameters` estimates under the same name.

        The columns are rebuilt there until they agree, see :meth:`relinearised`.
        """
        return ()

    @property
    def edges(self) -> tuple[str, ...]:
        """Settings that are times at which the torque jumps."""
        return ()

    @property
    def variable(self) -> str:
        """What its picture is drawn over: ``position``, ``velocity``, ``acceleration`` or time."""
        return "position"

    @property
    def n_comparisons(self) -> int:
        """Number of hypotheses that it stands for (the grid of a search), at least 1."""
        return 1

    @property
    def refits_model(self) -> bool:
        """Its parameters are the model's own, fitted again beside others: the last resort."""
        return False

    @property
    def alignment(self) -> bool:
        """It concerns zeros of joints or the base, which few motions separate."""
        return False

    @property
    def extrapolates(self) -> bool:
        """Its columns are right at any single state, not only along what was recorded."""
        return not self.transient

    @property
    def transient(self) -> bool:
        """It occurs once, or changes with time: the same state at another time lacks it."""
        return False

    @property
    def common_cause(self) -> bool:
        """One parameter for all joints, preferred unless one for each explains more."""
        return self.site.kind is Kind.ARM and self.unrestricted is not None

    @property
    def shifts_positions(self) -> bool:
        """It changes what positions mean: merged into a model before others."""
        return False

    # What a model does with it.
    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        """Return a model's parameters with (k,) theta merged in; ``None``: no file can hold it.

        Args:
            values: The model's parameters; encoder zeros that were found are in.
            theta: Parameters, of columns that are functions of *measured* positions.
            motion: The motion that they were fitted to.
        """
        return None

    def reading_errors(self, theta: Array) -> ReadingErrors | None:
        """Return the errors of the readings that (k,) theta amounts to; ``None``: it is none."""
        return None

    def plausible(self, theta: Array) -> bool:
        """Return whether (k,) theta is physically possible.

        Every parameter must lie within its meaning's range, and at most :data:`MAX_REMOVED` of the
        model's friction may be missing. Otherwise the fit describes some other cause.
        """
        for name, value in self.parameters(theta).items():
            meaning = self.EFFECT.meaning(name)
            if not meaning.least <= value <= meaning.greatest:
                return False
        return self.removed_fraction(theta) <= MAX_REMOVED

    def typical(self, theta: Array) -> bool:
        """Return whether (k,) theta is what one meets with, not only possible."""
        return True

    def clamped(self, theta: Array) -> Hypothesis | None:
        """Return the hypothesis at the nearest typical settings, if (k,) theta is not plausible."""
        return None

    @property
    def unclamped(self) -> Hypothesis:
        """The same with its settings free, whether or not they are typical."""
        return self

    def removed_fraction(self, theta: Array) -> float:
        """Return which fraction of the model's own (:attr:`removable`) theta removes.

        Zero where it adds, and against a reference, of which the amount is unknown.
        """
        less = max(-float(np.min(theta)), 0.0)
        if less == 0.0 or self.against_reference:
            return 0.0
        return less / self.removable if self.removable > 0.0 else np.inf

    # How its settings are found.
    def relinearised(self, theta: Array) -> Hypothesis:
        """Return the hypothesis with its :attr:`fixed_point` settings as (k,) theta implies."""
        if not self.fixed_point:
            return self
        found = self.parameters(theta)
        return replace(
            self, setting={**self.setting, **{name: found[name] for name in self.fixed_point}}
        )

    def search_range(self, name: str, motion: Motion) -> tuple[float, float]:
        """Return the bounds between which a setting of :attr:`refine` is optimised."""
        centre = self.setting[name]
        return 0.4 * centre, 2.5 * centre

    # How it compares with others.
    @property
    def unrestricted(self) -> Hypothesis | None:
        """The same with a parameter for each joint or direction, where this one equates some."""
        return None

    @property
    def judged_at(self) -> tuple[int, ...]:
        """Joints whose error decides about it; empty: all that its torque acts on."""
        return () if self.site.kind is Kind.LINK else self.joints

    @property
    def depends_on(self) -> int | None:
        """Joint whose variable its picture is drawn over; ``None``: the affected one's own."""
        return None

    @property
    def extrapolated(self) -> Hypothesis:
        """The same where nothing was recorded yet: what recordings bound is not bounded there."""
        return self

    @property
    def separated_by(self) -> str:
        """Which recording would separate it from others; ``""``: other poses would."""
        return ""

    # Its names and words.
    @property
    def effect(self) -> str:
        """Name in the vocabulary."""
        return self.EFFECT.NAME

    @property
    def place(self) -> str:
        """Form or site as findings name it."""
        return self.form or self.site.kind.value

    @property
    def of_joint(self) -> bool:
        """Whether its site is one joint."""
        return self.site.kind is Kind.JOINT

    @property
    def key(self) -> tuple[str, tuple[int, ...], str]:
        """Its identity, whatever its settings."""
        return self.effect, self.joints, self.place

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(self.arm.joint_names[joint] for joint in self.joints)

    @property
    def where(self) -> str:
        """Its site in words, or its joints if it spans several."""
        return " and ".join(self.names) if self.names[1:] else self.site.words(self.arm)

    @property
    def subject(self) -> str:
        """What it would change, in words."""
        return f"{self.EFFECT.title()} of {self.site.words(self.arm)}"

    @property
    def against(self) -> str:
        """What the data are compared with, in words."""
        return compared_with(self.against_reference)

    def meaning(self, name: str) -> Meaning:
        """Return the meaning of a parameter."""
        return self.EFFECT.meaning(name)

    def unit(self, name: str) -> str:
        """Return the unit of a parameter at this site; a joint that slides has N and m."""
        return self.site.unit(self.arm, self.meaning(name).unit)

    def claim(self, parameters: Mapping[str, Estimate]) -> str:
        """Return the sentence of a finding with these parameters.

        Raises:
            EffectError: ``CLAIM`` names an unknown parameter.
        """
        return self._claim(parameters, self._in_words(parameters))

    def hedges(self, parameters: Mapping[str, Estimate]) -> bool:
        """Return whether that sentence has `perhaps` before one of the parameters it names."""
        words = self._in_words(parameters)
        self._claim(parameters, words)
        return words.hedged

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        """Return the sentence of a finding, from its parameters and these in words."""
        try:
            return self.CLAIM.format_map(words)
        except (LookupError, ValueError) as error:
            known = ", ".join((*self.words(), *parameters))
            raise EffectError(
                self.effect, f"CLAIM {self.CLAIM!r}: {error}, expected of {known}"
            ) from error

    def words(self) -> dict[str, str]:
        """Return the words of ``CLAIM`` that are no parameters."""
        joint, other, *_ = (*self.names, "", "")
        where = self.site.words(self.arm)
        return {
            "where": where, "joint": joint, "other": other, "form": self.form,
            "model": self.against,
        }  # fmt: skip

    def _in_words(self, parameters: Mapping[str, Estimate]) -> Words:
        return Words(self.words(), parameters, self.meaning)

    def remedy(self, carried: bool) -> str:
        """Return what to do about it, in one line; ``carried``: the extended model has it."""
        joint = self.names[0] if self.names else self.site.words(self.arm)
        return remedy_text(
            self.EFFECT.REMEDY.format(joint=joint), carried, self.EFFECT.READS_WRONGLY
        )

    def __str__(self) -> str:
        """Return effect, joints and form."""
        where = " and ".join(self.names) or "the arm"
        detail = "" if self.place in ("joint", "") else f" ({self.place})"
        return f"{self.effect} at {where}{detail}"


def remedy_text(what: str, carried: bool, reading: bool = False) -> str:
    """Return a remedy, with the extended model as the alternative where that has the effect."""
    does = "reads recordings correctly in spite of it" if reading else "has it"
    model = f"use the extended model, which {does}" if carried else ""
    return "; or ".join(part for part in (what, model) if part)


def compared_with(reference: bool) -> str:
    """Return what a recording is compared with, in words: the model, or a reference."""
    return "the reference" if reference else "the model"


def spread(row: Array, *values: Array) -> Array:
    """Return (N, n, k) joint torques of k (N,) torques at a joint or motor, given its (n,) row."""
    columns = np.zeros((len(values[0]), len(row), len(values)))
    for joint in np.flatnonzero(row).tolist():
        for index, value in enumerate(values):
            np.multiply(value, row[joint], out=columns[:, joint, index])
    return columns
