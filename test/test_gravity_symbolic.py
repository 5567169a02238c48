"""The closed form and the printed document against an exact derivation from the energy.

The derivation is ``docs/derive_gravity_model.py``; it knows the DH table and shares nothing with
``dvrk_gravity.gravity``.
"""

from __future__ import annotations

import importlib.util
import itertools

import numpy as np
import pytest
import sympy
from support import REPOSITORY

from dvrk_gravity.gravity import LINKS, Lengths, LinkMass, beta_from_links, regressor

_SPEC = importlib.util.spec_from_file_location(
    "derive_gravity_model", REPOSITORY / "docs" / "derive_gravity_model.py"
)
derive = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(derive)

PRIMES = Lengths(*(derive.LENGTHS[n] for n in ("l_arm", "l_forearm", "h", "l'_forearm")))
NAMES = dict(zip(LINKS, ("1", "2", "3", "4", "5", "6", "7", "4'", "5'"), strict=True))


@pytest.fixture(scope="module")
def derived():
    return derive.columns()


def evaluate(entries, q, gravity):
    """Return ring elements at poses, (number of entries, N)."""
    function = sympy.lambdify(
        [g.as_expr() for g in derive.GENERATORS], [e.as_expr() for e in entries], cse=True
    )
    values = function(*np.cos(q.T), *np.sin(q.T), *np.divide(gravity, -9.81))
    return np.array([np.broadcast_to(v, len(q)) for v in values])


def test_the_exact_frames_are_those_of_numerical_dh_matrices():
    q = np.random.default_rng(1).uniform(-3, 3, 7)
    numeric = np.eye(4)
    for (alpha, a, d, offset), angle in zip(derive.DH, q, strict=True):
        theta, alpha = angle + offset * np.pi / 2, alpha * np.pi / 2
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        a, d = derive.LENGTHS.get(a, 0), derive.LENGTHS.get(d, 0)
        numeric = numeric @ [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    rotation, origin = derive.frames()[-1]
    exact = [derive.RING.ground_new(0) + x for x in (*rotation.ravel(), *origin)]
    values = evaluate(exact, q[None], (0, 0, -9.81))[:, 0]
    np.testing.assert_allclose(values[:9].reshape(3, 3), numeric[:3, :3], atol=1e-14)
    np.testing.assert_allclose(values[9:], numeric[:3, 3], atol=1e-13)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (1.3, -2.1, -9.4)])
def test_closed_form_is_the_derivation(derived, gravity):
    q = np.random.default_rng(2).uniform(-np.pi, np.pi, (1000, 7))
    exact = evaluate([entry for column in derived for entry in column], q, gravity)
    exact = exact.reshape(14, 7, -1).transpose(2, 1, 0)
    assert abs(exact).max() > 0.5
    np.testing.assert_allclose(regressor(q, gravity, 14), exact, rtol=0, atol=1e-14)


def test_beta_holds_every_mass_and_moment_exactly(derived):
    """With lengths that are primes the coefficients are integers, and so are compared as such."""
    for name in LINKS:
        rotation, origin = derive.link_frames()[NAMES[name]]
        at_origin = beta_from_links({name: LinkMass(1.0)}, PRIMES, 14) / 9.81
        exact = derive.coordinates(derive.torque_of_height(origin), derived)
        assert exact == at_origin.tolist(), name
        for axis, unit in zip(rotation.T, np.eye(3), strict=True):
            out = beta_from_links({name: LinkMass(1.0, tuple(unit))}, PRIMES, 14) / 9.81
            moment = np.rint(out - at_origin)
            np.testing.assert_allclose(out - at_origin, moment, atol=1e-12)
            exact = derive.coordinates(derive.torque_of_height(axis), derived)
            assert exact == moment.tolist(), name


def test_row_1_and_7_of_the_document_are_zero(derived):
    for column in derived[:10]:
        vertical = derive.vertical(column)
        assert vertical[0] == vertical[6] == 0


def test_every_entry_of_the_document_is_right_missing_or_mended(derived):
    for row, k in itertools.product(derive.JOINTS, range(1, 11)):
        entry = derive.vertical(derived[k - 1])[row - 1]
        remark = derive.verdict(row, k, entry)
        if (row, k) in derive.MENDED:
            assert remark.startswith("brackets lost"), (row, k)
        elif k in derive.PRINTED[row]:
            assert remark == "", (row, k)
        else:
            assert remark == "missing", (row, k)
            assert entry == 0 or row == 4, (row, k)
        assert derive.parse(derive.SHORT[row][k - 1]) == entry, (row, k)


def test_a_wrong_entry_would_be_called_wrong(derived):
    entry = derive.vertical(derived[4])[1]
    assert derive.verdict(2, 5, entry) == ""
    assert derive.verdict(2, 5, -entry) == "wrong"
    assert derive.verdict(5, 7, entry) == "wrong"
    with pytest.raises(ValueError, match="q3"):
        derive.parse("s_2 + q3c_4s_6")


def test_printed_beta_differs_in_link_7_and_beta10_only():
    differences = []
    for k, terms in enumerate(derive.derived_beta()[:10], start=1):
        printed = derive.parse_beta(derive.PRINTED_BETA[k - 1])
        differences += [(k, "add", t) for t in terms if printed.get(t) != terms[t]]
        differences += [(k, "strike", t) for t in printed if printed[t] != terms.get(t)]
    assert differences == [
        (1, "add", "l_arm m7"),
        (3, "add", "l_forearm m7"),
        (4, "add", "h m7"),
        (9, "add", "cm7z m7"),
        (10, "add", "cm6x m6"),
        (10, "strike", "cm6z m6"),
    ]


def test_only_one_reading_of_the_parallelograms_frames_fits_the_printed_beta():
    found = derive.parallelogram_readings()
    assert found["4'"] == ["origin at the crank's tip; x = -x2, y = -y2, z = z2"]
    assert found["5'"] == ["origin at the crank's tip; x = z3, y = -x3, z = -y3"]
    assert found["tried"] == ["192"]
