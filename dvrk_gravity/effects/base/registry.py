"""Which effects there are: the package's own, and those that others register."""

from __future__ import annotations

import inspect
from functools import cache

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect
from dvrk_gravity.effects.base.linear_term import LinearTerm
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.sensor import SensorEffect
from dvrk_gravity.effects.base.term import Term
from dvrk_gravity.errors import EffectError

ENTRY_POINTS = "dvrk_gravity.effects"
_effects: dict[str, type[Effect]] = {}


def register(effect: type[Effect]) -> type[Effect]:
    """Make an effect known to all who use effects. May decorate its class.

    Effects are believed in the order in which they are registered.

    Raises:
        EffectError: It is no effect, or not a whole one; another effect has its name.
    """
    if not (isinstance(effect, type) and issubclass(effect, Effect)):
        raise EffectError(repr(effect), "is no class derived from dvrk_gravity.effects.Effect")
    name = getattr(effect, "NAME", "")
    if not (isinstance(name, str) and name.isidentifier()):
        raise EffectError(effect.__qualname__, f"NAME is {name!r}, expected an identifier")
    if inspect.isabstract(effect):
        missing = ", ".join(sorted(effect.__abstractmethods__))
        raise EffectError(name, f"{effect.__qualname__} does not define {missing}")
    if issubclass(effect, LinearTerm) and not (
        effect.COEFFICIENTS or effect.theta is not LinearTerm.theta
    ):
        raise EffectError(name, f"{effect.__qualname__} does not define COEFFICIENTS")
    if issubclass(effect, Term) and effect.FRICTION and effect.scaled is Term.scaled:
        raise EffectError(name, "FRICTION is True, which needs a method `scaled`")
    known = _effects.setdefault(name, effect)
    if known is not effect:
        raise EffectError(name, f"is registered already, by {known.__module__}")
    return effect


def effects() -> tuple[type[Effect], ...]:
    """Return all effects, those of installed packages among them, the most readily believed first.

    Raises:
        EffectError: A package names an effect that cannot be imported or registered.
    """
    _load_entry_points()
    return tuple(sorted(_effects.values(), key=lambda effect: effect.UNEXPLAINED))


def terms() -> tuple[type[Term], ...]:
    """Return the effects that are terms of a torque model."""
    return tuple(effect for effect in effects() if issubclass(effect, Term))


def stated_terms(arm: Arm) -> tuple[Term, ...]:
    """Return the terms that an arm's own file states."""
    return tuple(term for effect in terms() if (term := effect.from_arm(arm)) is not None)


def stated_weight(arm: Arm, q: Array) -> Array | None:
    """Return (…, n) efforts that hold the masses in an arm's file; ``None`` if it states none."""
    weights = (effect.from_arm(arm) for effect in terms() if effect.WEIGHT_OF_ARM)
    weight = next((term for term in weights if term is not None), None)
    return None if weight is None else weight.torque(State.of(q))


def sensor_effects() -> tuple[type[SensorEffect], ...]:
    """Return the effects that are faults of readings."""
    return tuple(effect for effect in effects() if issubclass(effect, SensorEffect))


def reading_effect(arm: Arm, errors: ReadingErrors) -> type[SensorEffect]:
    """Return the effect that an arm's readings have, of errors that are one effect's.

    Raises:
        EffectError: They are none's.
    """
    found = [effect for effect in sensor_effects() if effect.written(arm, errors)]
    if not found:
        raise EffectError("of readings", "has none of these errors")
    return found[0]


def unexplained() -> type[Effect]:
    """Return the effect that stands for what no other explains."""
    return next(effect for effect in effects() if effect.UNEXPLAINED)


def named(name: str) -> type[Effect]:
    """Return the effect of a name.

    Raises:
        KeyError: There is none.
    """
    _load_entry_points()
    return _effects[name]


def from_other_packages() -> dict[str, str]:
    """Return the names of registered effects of other packages by the modules that define them."""
    package = __name__.partition(".")[0]
    return {
        effect.__module__: name
        for name, effect in _effects.items()
        if effect.__module__.partition(".")[0] != package
    }


def rank(name: str) -> int:
    """Return how readily an effect is believed: the lower, the more readily."""
    return effects().index(named(name))


def is_friction(name: str) -> bool:
    """Return whether an effect dissipates: see :attr:`Term.FRICTION`."""
    return any(term.FRICTION for term in terms() if name == term.NAME)


@cache
def _load_entry_points() -> None:
    from importlib.metadata import EntryPoint, entry_points

    try:
        found = entry_points(group=ENTRY_POINTS)
    except (TypeError, ValueError) as error:  # what importlib says of a line without `=`
        raise EffectError(
            "of an installed package", "its entry_points.txt has a line that is not name = value"
        ) from error
    for entry in found:
        package = entry.dist.name if entry.dist else "a package"
        if not EntryPoint.pattern.match(entry.value):
            raise EffectError(
                f"{entry.name!r} of {package}", f"is {entry.value!r}, no module:Class"
            )
        try:
            effect = entry.load()
        except (Exception, SystemExit) as error:  # a module of others may raise anything
            raise EffectError(
                f"{entry.value!r} of {package}",
                f"cannot be imported: {type(error).__name__}: {error}",
            ) from error
        register(effect)
