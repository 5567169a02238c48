"""Which changes of a model's columns are tried, and what a search starts with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dvrk_gravity.effects.elastic_cable import DEGREE
from dvrk_gravity.effects.presliding_hysteresis import DISPLACEMENTS
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.posture import POSTURE
from dvrk_gravity.identification.rigid_columns import RIGID

# Effects that moves of their own are made for; of others each column comes and goes alone.
WITH_MOVES = (
    "coulomb_friction", "elastic_cable", "presliding_hysteresis", "rotor_inertia",
    "viscous_friction", *RIGID, *POSTURE,
)  # fmt: skip
WRIST = (3, 4, 5, 6)  # joints whose rotors are no part of a link, as far as torque can tell


@dataclass(frozen=True)
class Move:
    """A change of the model that is tried.

    Attributes:
        add: Columns that come in.
        remove: Columns that go.
        text: What it is.
    """

    add: tuple[int, ...]
    remove: tuple[int, ...]
    text: str


def posture_moves(columns: Columns, inside: set[int]) -> Iterator[Move]:
    """Yield the tilt of the base and the zeros of joints that are not yet in."""
    for effect in POSTURE:
        free = [i for i in columns.select(effect=effect) if i not in inside]
        if effect == "base_tilt" and free:
            yield Move(tuple(free), (), effect)
        elif effect == "joint_offset":
            for i in free:
                name = columns.arm.joint_names[columns.columns[i].joint]
                yield Move((i,), (), f"{effect} {name}")


def term_moves(columns: Columns, inside: set[int]) -> Iterator[Move]:
    """Yield every change of what a model has, once each."""
    names = columns.arm.joint_names
    yield from _elastic_moves(columns, inside)
    for j, name in enumerate(names):
        places = _places(j)
        for place in places:
            where = f"{name} ({place})" if len(places) == 2 else name
            for effect in ("coulomb_friction", "viscous_friction"):
                here = columns.select(effect=effect, place=place, joint=j)
                both = inside & set(columns.select(effect=effect, joint=j))
                if here[0] not in inside:
                    yield Move(tuple(here), (), f"{effect} {where}")
                elif effect != "viscous_friction" or len(both) > 1:
                    # Every joint has viscous friction; what is too little to show would
                    # still be in the other parameters, beyond their intervals.
                    yield Move((), tuple(here), f"without {effect} {where}")
            elements = columns.select(effect="presliding_hysteresis", place=place, joint=j)
            for element, size in zip(elements, DISPLACEMENTS, strict=True):
                text = f"presliding_hysteresis {where}, {size:g} rad"
                if element in inside:
                    yield Move((), (element,), f"without {text}")
                    continue
                yield Move((element,), (), text)
                for other in elements:
                    if other in inside:
                        yield Move((element,), (other,), f"{text} instead of another")
        if len(places) == 2:
            yield from _place_moves(columns, inside, j)
        rotor = columns.select(effect="rotor_inertia", joint=j)[0]
        if rotor not in inside:
            yield Move((rotor,), (), f"rotor_inertia {name}")
    yield from _other_moves(columns, inside)


def _other_moves(columns: Columns, inside: set[int]) -> Iterator[Move]:
    for i, column in enumerate(columns.columns):
        if column.effect not in WITH_MOVES:
            where = column.site.words(columns.arm)
            text = f"{column.effect} {where}" + f", {column.index}" * (column.index > 0)
            if i in inside:
                yield Move((), (i,), f"without {text}")
            else:
                yield Move((i,), (), text)


def _place_moves(columns: Columns, inside: set[int], j: int) -> Iterator[Move]:
    """Move a joint's friction to its motor or back."""
    for effect in ("coulomb_friction", "viscous_friction", "presliding_hysteresis"):
        places = [columns.select(effect=effect, place=p, joint=j) for p in ("joint", "motor")]
        for here, there, where in ((*places, "motor"), (*places[::-1], "joint")):
            pairs = [(a, b) for a, b in zip(here, there, strict=True) if a in inside]
            pairs = [(a, b) for a, b in pairs if b not in inside]
            if pairs:
                gone, come = zip(*pairs, strict=True)
                yield Move(come, gone, f"{effect} {columns.arm.joint_names[j]} at the {where}")


def _elastic_moves(columns: Columns, inside: set[int]) -> Iterator[Move]:
    for j, name in enumerate(columns.arm.joint_names):
        powers = columns.select(effect="elastic_cable", joint=j)
        degree = max((k for k in range(DEGREE + 1) if powers[k] in inside), default=-1)
        # A cubic may help where neither a slope nor a parabola does.
        for higher in range(degree + 1, min(degree + 4, DEGREE + 1)):
            yield Move(tuple(powers[degree + 1 : higher + 1]), (),
                       f"elastic_cable {name}, degree {higher}")  # fmt: skip
        if degree > 0:
            yield Move((), (powers[degree],), f"elastic_cable {name}, degree {degree - 1} only")
        elif degree == 0:
            yield Move((), (powers[0],), f"without a constant torque on {name}")


def _places(j: int) -> tuple[str, ...]:
    """Return where friction of a joint may live: motors 3 and 4 move more than their joint."""
    return ("joint", "motor") if j in (2, 3) else ("joint",)


def starts(columns: Columns, effects: Sequence[str] | None = None) -> list[list[int]]:
    """Return what searches start with: the plainest model, and one with presliding everywhere.

    Args:
        columns: The columns.
        effects: Effects that may be used besides the rigid body; ``None``: all.
    """
    everywhere = [
        index
        for j in range(len(columns.arm.joint_names))
        for place in _places(j)
        for index in columns.select(effect="presliding_hysteresis", place=place, joint=j)
    ]
    plain = start_columns(columns)
    permitted = {
        i
        for i, column in enumerate(columns.columns)
        if columns.offers(column) and (effects is None or column.effect in (*RIGID, *effects))
    }
    found = [[i for i in one if i in permitted] for one in (plain, sorted(plain + everywhere))]
    return found if found[0] != found[1] else found[:1]


def start_columns(columns: Columns) -> list[int]:
    """Return the columns of the plainest model that can hold.

    It is the rigid body, friction, a constant torque, and the rotors of the wrist, whose inertia
    is none of a link's.
    """
    chosen = columns.select(effect="link_inertia") + columns.select(effect="gravity")
    chosen += columns.select(effect="elastic_cable", index=0)
    for effect in ("coulomb_friction", "viscous_friction"):
        for j in range(len(columns.arm.joint_names)):
            place = "motor" if j == 2 else "joint"
            chosen += columns.select(effect=effect, place=place, joint=j)
    for j in WRIST:
        chosen += columns.select(effect="rotor_inertia", joint=j)
    return sorted(chosen)
