"""Effects from outside the package in a console's file: polynomials of a joint, dry friction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from console_files import assert_as_console, own_model
from outside_term import OutsideTerm

from dvrk_gravity.console import convert_model, export
from dvrk_gravity.effects import CoulombFriction, JointPolynomials, evaluate
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel


@dataclass(frozen=True, eq=False)
class Counterbalance(OutsideTerm):
    """Springs of joints' own positions."""

    NAME = "counterbalance"

    springs: JointPolynomials

    @property
    def polynomials(self):
        return self.springs

    def torque(self, state):
        return evaluate(self.springs.mean, self.springs.valid.hold(state.q))


class BearingFriction(CoulombFriction):
    NAME = "bearing_friction"


def test_an_effect_from_outside_that_states_polynomials_is_in_the_file():
    model = TorqueModel.from_parameters(own_model())
    cable = model.term("directional_cable").polynomials
    coefficients = np.zeros((3, 7))
    coefficients[:, 2] = 0.02, 0.03, -0.01
    springs = JointPolynomials(coefficients, coefficients, cable.valid)
    model = replace(model, terms=(*model.terms, Counterbalance(springs)))
    result = convert_model(model, "1")
    assert result.exact
    assert_as_console(result.file.document, model)
    with pytest.raises(
        ConfigError, match=r"counterbalance.*a blend of two directions.*the console has one"
    ):
        export(replace(model, terms=(*model.terms, Counterbalance(cable))), "1")


def test_dry_friction_from_outside_is_in_the_file_as_coulomb_friction_is():
    levels = {"coulomb_friction.joint_positive": (0.03, 0.02, 0.02, 0.004, 0.003, 0.002, 0.001),
              "coulomb_friction.motor_positive": (0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.0)}  # fmt: skip
    model = TorqueModel.from_parameters(own_model() | levels)
    own = model.term("coulomb_friction")
    given = BearingFriction(**vars(own))
    outside = replace(model, terms=tuple(given if term is own else term for term in model.terms))
    files = [convert_model(each, "1").file for each in (model, outside)]
    assert files[0] == files[1]
