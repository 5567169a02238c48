"""Which effects there are: the package's own, and those that others register."""

from __future__ import annotations

from functools import cache

from dvrk_gravity.effects.base.effect import Effect
from dvrk_gravity.effects.base.term import Term
from dvrk_gravity.errors import ConfigError

ENTRY_POINTS = "dvrk_gravity.effects"
_effects: dict[str, type[Effect]] = {}


def register(effect: type[Effect]) -> type[Effect]:
    """Make an effect known to all who use effects. May decorate its class.

    Effects are believed in the order in which they are registered.

    Raises:
        ValueError: Another effect has its name.
    """
    known = _effects.setdefault(effect.NAME, effect)
    if known is not effect:
        raise ValueError(f"effect {effect.NAME!r} is registered already, by {known.__module__}")
    return effect


def effects() -> tuple[type[Effect], ...]:
    """Return all effects, those of installed packages among them, the most readily believed first.

    Raises:
        ConfigError: A package names an effect that cannot be imported.
        ValueError: Two with one name.
    """
    _load_entry_points()
    return tuple(sorted(_effects.values(), key=lambda effect: effect.NAMELESS))


def terms() -> tuple[type[Term], ...]:
    """Return the effects that are terms of a torque model."""
    return tuple(effect for effect in effects() if issubclass(effect, Term))


def named(name: str) -> type[Effect]:
    """Return the effect of a name.

    Raises:
        KeyError: There is none.
    """
    _load_entry_points()
    return _effects[name]


def rank(name: str) -> int:
    """Return how readily an effect is believed: the lower, the more readily."""
    return effects().index(named(name))


def is_friction(name: str) -> bool:
    """Tell whether an effect dissipates: see :attr:`Term.FRICTION`."""
    return any(term.FRICTION for term in terms() if name == term.NAME)


@cache
def _load_entry_points() -> None:
    from importlib.metadata import entry_points

    for entry in entry_points(group=ENTRY_POINTS):
        try:
            effect = entry.load()
        except (ImportError, AttributeError) as error:
            package = entry.dist.name if entry.dist else "a package"
            raise ConfigError(
                f"{ENTRY_POINTS} of {package}", entry.value, f"an effect ({error})"
            ) from error
        register(effect)
