"""The document's exercises, and the MTM as a chain in the document's terms."""

import re

import numpy as np
import pytest
import yaml
from support import REPOSITORY

from dvrk_gravity.__main__ import main
from dvrk_gravity.newton_euler import inverse_dynamics, parse, read

EXERCISES = REPOSITORY / "config" / "exercises"
HALF_DECIMAL = 0.005 + 1e-9

# As printed: Fx Fy Fz in N, Mx My Mz in N·m, a row for each joint.
PRINTED = {
    "2_1_without_gravity": [[-2.82, 3.48, 0, 0, 0, 0], [-0.29, 3.35, 0, 0, 0, 0]],
    "2_2_with_gravity": [[383.53, -14.70, 0, 0, 0, 0], [116.29, -130.85, 0, 0, 0, 0]],
    "3_2_with_gravity": [
        [134.69, -78.84, 0, -11.71, -20.21, 0],
        [0, -29.29, 0, -17.57, -20.21, -11.71],
    ],
    "4_1_without_gravity": [
        [-2.99, 4.11, 1.18, 0.53, -1.82, 0],
        [0.02, 1.18, -4.05, -0.01, 2.33, 0],
        [-0.07, 0.52, -1.20, 0, 0.22, 0],
    ],
    "4_1_with_gravity": [
        [-2.99, 4.11, 452.44, 87.76, -458.95, 0],
        [0.02, 256.24, -4.05, -0.01, 2.33, 0],
        [10.15, 58.48, -1.20, 0, 0.22, 0],
    ],
}
# As printed: masses and joint rates.
SETTINGS = {
    "2_1": ([22, 19], [0.2, 0.15], [0.1, 0.085]),
    "2_2": ([22, 19], [-0.8, 0.35], [-0.4, 0.1]),
    "3_1": ([10, 6], [0.08, 0.03], [0.1, 0.01]),
    "3_2": ([10, 6], [-0.4, -0.08], [-0.1, -0.01]),
    "4_1": ([20, 20, 6], [0.2, 0.15, -0.2], [0.1, 0.085, 0]),
}


def solve(name):
    mechanism, motion = read(EXERCISES / f"{name}.yaml")
    return inverse_dynamics(mechanism, motion.q, motion.qd, motion.qdd)


@pytest.mark.parametrize("name", PRINTED)
def test_printed_reactions_to_both_decimals(name):
    np.testing.assert_allclose(solve(name).reactions, PRINTED[name], rtol=0, atol=HALF_DECIMAL)


def test_both_halves_of_an_exercise_hold_what_is_printed_and_differ_in_gravity_only():
    for exercise, (mass, qd, qdd) in SETTINGS.items():
        dry = yaml.safe_load((EXERCISES / f"{exercise}_without_gravity.yaml").read_text())
        wet = yaml.safe_load((EXERCISES / f"{exercise}_with_gravity.yaml").read_text())
        assert (dry.pop("g_flag"), wet.pop("g_flag")) == (0, 1)
        assert dry.pop("title") != wet.pop("title")
        assert dry == wet
        assert [link["mass"] for link in dry["links"]] == mass
        assert [link["length"] for link in dry["links"]] == [1, 0.8, 0.35][: len(mass)]
        assert (dry["qd"], dry["qdd"]) == (qd, qdd)


def test_every_exercise_is_there_and_no_other():
    expected = {f"{name}_{g}_gravity" for name in SETTINGS for g in ("with", "without")}
    assert {path.stem for path in EXERCISES.glob("*.yaml")} == expected


@pytest.mark.parametrize("name", ["4_1_with_gravity", "4_1_without_gravity"])
def test_the_impossible_inertias_of_4_1_need_their_flag(name):
    document = yaml.safe_load((EXERCISES / f"{name}.yaml").read_text())
    flags = [link.pop("accept_impossible_inertia", False) for link in document["links"]]
    assert flags == [True, True, False]
    with pytest.raises(Exception, match=r"^link 1: inertia: got .*0\.8.*sum of the other two"):
        parse(document)


def test_the_command_prints_the_documents_numbers(capsys):
    assert main(["newton-euler", str(EXERCISES / "3_2_with_gravity.yaml")]) == 0
    shown = capsys.readouterr().out
    rows = [line.split() for line in shown.splitlines() if re.match(r" +\d", line)]
    numbers = np.array([[float(cell) for cell in row[4:]] for row in rows])
    np.testing.assert_array_equal(numbers, PRINTED["3_2_with_gravity"])
