"""Which changes of a model's columns are tried, and what a search starts with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dvrk_gravity.effects import ModelChange
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.rigid_columns import RIGID


def term_moves(columns: Columns, inside: set[int]) -> Iterator[ModelChange]:
    """Yield every change of what a model has, once each."""
    for term in columns.terms_looked_for:
        yield from term.moves(columns, inside)


def starts(columns: Columns, effects: Sequence[str] | None = None) -> list[list[int]]:
    """Return what searches start with: the plainest model, and one with what helps together only.

    Args:
        columns: The columns.
        effects: Effects that may be used besides the rigid body; ``None``: all.
    """
    plain = start_columns(columns)
    rich = sorted(
        {*plain, *(i for term in columns.terms_looked_for for i in term.together(columns))}
    )
    permitted = {
        i
        for i, column in enumerate(columns.columns)
        if columns.offers(column) and (effects is None or column.effect in (*RIGID, *effects))
    }
    found = [[i for i in chosen if i in permitted] for chosen in (plain, rich)]
    return found if found[0] != found[1] else found[:1]


def start_columns(columns: Columns) -> list[int]:
    """Return the columns of the plainest model that can hold: the rigid body, and little more."""
    chosen = {i for effect in RIGID for i in columns.select(effect=effect)}
    chosen |= {i for term in columns.terms_looked_for for i in term.plainest(columns)}
    return sorted(chosen)
