"""What effects from outside the package are made of that tests put into a model themselves."""

from __future__ import annotations

from dvrk_gravity.effects import Term


class OutsideTerm(Term):
    """A term that no file knows."""

    @classmethod
    def schema(cls, arm):
        return ()

    @classmethod
    def from_parameters(cls, arm, values):
        return None

    def parameters(self):
        return {}
