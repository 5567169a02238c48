"""The steps of a search for a model's terms, from wherever a walk of such steps leads."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import product

import diagnosed
import known_mtm
import numpy as np
import pytest

from dvrk_gravity.effects import LinearTerm, SearchMove
from dvrk_gravity.model import Columns

# Of arms some of whose motors move several joints.
SEARCHED = [
    pytest.param(columns, term, id=f"{arm.name}-{term.NAME}")
    for arm in (diagnosed.ARM, known_mtm.ARM)
    for columns in [Columns(arm, arm.lower, arm.upper)]
    for term in columns.candidate_terms
]


def after(inside: set[int], move: SearchMove) -> set[int]:
    return (inside | set(move.add)) - set(move.remove)


def walk(columns: Columns, term: LinearTerm) -> Iterator[tuple[set[int], list[SearchMove]]]:
    """Yield states of a search for one effect, from the columns of others on, and their steps."""
    random, own = np.random.default_rng(0), columns.select(effect=term.NAME)
    inside = set(range(len(columns.columns))).difference(own)
    for _ in range(100):
        moves = [*term.moves(columns, inside)]
        yield inside, moves
        if not moves:
            return
        inside = after(inside, moves[random.integers(len(moves))])


@pytest.mark.parametrize(("columns", "term"), SEARCHED)
def test_a_step_adds_what_is_not_there_removes_what_is_and_is_no_other_step_s(columns, term):
    """Of several settings it leaves one at a site, and another one is the next."""
    own, known = set(columns.select(effect=term.NAME)), columns.columns
    for inside, moves in walk(columns, term):
        ends = {frozenset(after(inside, move)) for move in moves} - {frozenset(inside)}
        assert len(ends) == len(moves)
        for move in moves:
            assert inside.isdisjoint(move.add)
            assert inside.issuperset(move.remove)
            assert own.issuperset(move.add + move.remove)
            families = [known[i].family for i in after(inside, move) & own if known[i].family]
            assert len(set(families)) == len(families), move
            for old, new in product(move.remove, move.add if families else ()):
                if {known[i].site for i in move.remove} == {known[new].site}:
                    assert abs(known[old].index - known[new].index) == 1, move


@pytest.mark.parametrize(("columns", "term"), SEARCHED)
def test_all_that_an_effect_has_comes_and_goes_but_for_what_every_arm_has(columns, term):
    """Every motor has a rotor, every joint viscous friction; a polynomial goes from its end."""
    come, own = set[int](), set(columns.select(effect=term.NAME))
    for inside, moves in walk(columns, term):
        come.update(*(move.add for move in moves))
        sites = {i: columns.columns[i].joint for i in inside & own}
        count = Counter(sites.values())
        may_go = {
            "rotor_inertia": set(),
            "viscous_friction": {i for i in sites if count[sites[i]] > 1},
            "elastic_cable": {i for i in sites if columns.columns[i].index == count[sites[i]] - 1},
        }.get(term.NAME, set(sites))
        assert {i for move in moves if not move.add for i in move.remove} == may_go
    assert come == own
