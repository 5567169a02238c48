"""The description of a mechanism: what is refused, and what the command prints."""

import copy

import numpy as np
import pytest
import yaml

from dvrk_gravity.__main__ import main
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.newton_euler import JointType, parse


def a_link(length, mass, com, moments):
    return {"length": length, "mass": mass, "com": com, "inertia": np.diag(moments).tolist()}


GOOD = {
    "title": "Two links",
    "angle_unit": "deg",
    "links": [
        {
            "length": 1.0,
            "mass": 10,
            "com": [0.5, 0, 0],
            "inertia": np.diag([0.1, 0.4, 0.4]).tolist(),
        },
        {
            "length": 0.8,
            "mass": 6,
            "com": [0, 0, 0.4],
            "inertia": np.diag([0.3, 0.3, 0.1]).tolist(),
        },
    ],
    "joints": [{"type": 0, "rotation": [0, 0, 0]}, {"type": 1, "rotation": [0, 90, 0]}],
    "g_flag": 1,
    "forces": [[1, 2, 3, 2, 0.1, 0, 0]],
    "moments": [[1, 2, 3, 1]],
    "q": [30, 0.2],
    "qd": [0.1, 0.2],
    "qdd": [0.3, 0.4],
}


def with_value(path, value):
    """GOOD with one value replaced."""
    document = copy.deepcopy(GOOD)
    *parents, last = path
    target = document
    for key in parents:
        target = target[key]
    target[last] = value
    return document


INERTIA = ("links", 1, "inertia")
REFUSED = [
    (("links", 1, "mass"), -6, r"link 2: mass: got -6\.0, expected 0 kg or more"),
    (("links", 0, "mass"), "1e-3", r"link 1: mass: got '1e-3', expected a number .*1\.0e-3"),
    (INERTIA, [[0.3, 0.1, 0], [0, 0.3, 0], [0, 0, 0.3]], r"link 2: inertia: got .*symmetric"),
    # Symmetric, positive entries, one negative principal moment.
    (INERTIA, [[0.3, 0.5, 0], [0.5, 0.3, 0], [0, 0, 0.3]], r"link 2: inertia: got .*-0\.2 kg"),
    (INERTIA, [[0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.8]], r"link 2: inertia: .*\(0\.8 .*\(0\.4\)"),
    (("joints", 0, "type"), 3, r"joint 1: type: got 3"),
    (("forces", 0, 3), 3, r"forces row 1: link: got 3\.0, expected the number of a link, 1 to 2"),
    (("qd",), [[0, 0], [0, 0]], r"qd: got 'shape \(2, 2\)'"),
    (("g_flag",), 2, r"g_flag: got 2, expected 0 or 1"),
    (("gravity_direction",), [0, 0, 0], r"gravity_direction: got .*, expected a direction"),
    (("mas",), 1, r"mas: got 1, expected one of the keys links"),
]


def test_a_bad_value_is_named_with_its_link_and_field():
    for path, value, message in REFUSED:
        with pytest.raises(ConfigError, match="^" + message) as caught:
            parse(with_value(path, value))
        assert "\n" not in str(caught.value)
    for key in ("links", "joints", "q", "qd", "qdd"):
        document = {name: value for name, value in GOOD.items() if name != key}
        with pytest.raises(ConfigError, match=f"^{key}: got nothing, expected a value"):
            parse(document)


def test_a_massless_link_has_no_inertia():
    document = with_value(("links", 1, "mass"), 0)
    with pytest.raises(ConfigError, match=r"^link 2: inertia: .*zeros, as the link has no mass"):
        parse(document)
    document["links"][1]["inertia"] = [[0, 0, 0]] * 3
    assert parse(document)[0].links[1].mass == 0


def test_bodies_on_the_edge_of_the_triangle_inequality_are_accepted():
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    for moments in ([0, 0.4, 0.4], [0.1, 0.2, 0.3]):  # a thin rod, a flat plate
        turned = turn @ np.diag(moments) @ turn.T
        mechanism, _ = parse(with_value(INERTIA, turned.tolist()))
        np.testing.assert_allclose(mechanism.links[1].inertia, turned)


def test_what_is_read_is_what_is_written():
    mechanism, motion = parse(GOOD)
    assert [joint.type for joint in mechanism.joints] == [JointType.REVOLUTE, JointType.PRISMATIC]
    # Degrees turn into radians for the revolute joint only, and only in q.
    np.testing.assert_allclose(motion.q, [np.pi / 6, 0.2], rtol=1e-15)
    np.testing.assert_array_equal(motion.qd, [0.1, 0.2])
    np.testing.assert_allclose(
        mechanism.joints[1].rotation, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15
    )
    np.testing.assert_allclose(mechanism.gravity, [0, -9.81, 0], rtol=1e-15)
    np.testing.assert_array_equal(mechanism.forces, GOOD["forces"])
    np.testing.assert_array_equal(mechanism.moments, GOOD["moments"])


def test_gravity_flag_and_direction():
    off, _ = parse(with_value(("g_flag",), 0))
    np.testing.assert_array_equal(off.gravity, [0, 0, 0])
    tilted, _ = parse(with_value(("gravity_direction",), [3, 0, -4]))
    np.testing.assert_allclose(tilted.gravity, [0.6 * 9.81, 0, -0.8 * 9.81], rtol=1e-15)
    # The square of such a length is no number any more.
    far, _ = parse(with_value(("gravity_direction",), [3e307, 0, -4e307]))
    np.testing.assert_allclose(far.gravity, tilted.gravity, rtol=1e-15)


def test_the_command_answers_bad_files_in_one_line(tmp_path, capsys):
    path, missing = tmp_path / "chain.yaml", tmp_path / "none.yaml"
    for content, message in (
        (yaml.safe_dump(with_value(("links", 1, "mass"), -6)), "link 2: mass: got -6.0"),
        (yaml.safe_dump(with_value(("joints", 1, "type"), 2)), "qd: joint 2: got 0.2"),
        (yaml.safe_dump(with_value(("qd", 0), 1e200)), "expected values whose loads are finite"),
        ("links: [1, 2", "expected valid YAML"),
    ):
        path.write_text(content)
        assert main(["newton-euler", str(path)]) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        (line,) = printed.err.splitlines()
        assert line.startswith(f"dvrk_gravity newton-euler: {path}: ")
        assert message in line
    path.write_text(yaml.safe_dump(GOOD))
    nowhere = tmp_path / "no" / "folder.json"
    for words in ([missing], [tmp_path], [path, "--json", nowhere]):
        assert main(["newton-euler", *map(str, words)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert str(words[-1]) in line
