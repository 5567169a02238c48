"""Static poses of arms that are no MTM: identified, predicted elsewhere, diagnosed, compensated.

Efforts are the weight of a plant's links as Pinocchio (ECM, PSM) or MuJoCo (UR5) has it, friction
that sticks at more than half of its level, and noise. Neither knows the effects of the package.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from test_report import Page

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.tree import build_tree
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.diagnosis import diagnose, in_simulation
from dvrk_gravity.effects import State
from dvrk_gravity.effects.base import rigid_body
from dvrk_gravity.effects.base.link_prior import weight_directions
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.identification.base_parameters import base_weights
from dvrk_gravity.identification.result import Fit
from dvrk_gravity.identification.static_gravity import gravity_of
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile
from testing import mujoco_arms

NOISE = 0.003  # of a joint's effort limit
USED = 0.8  # of each joint's range
Weight = Callable[[np.ndarray, float], np.ndarray]


@dataclass(frozen=True, eq=False)
class Posed:
    """An arm that is posed, and what its first joints read.

    Attributes:
        arm: All of its joints.
        posed: How many of them are posed and recorded; the others stay at zero.
        weight: From (N, n) positions and the mass of a load, kg, to (N, n) efforts.
        friction: (n,) level at each joint, N·m or N.
        directed: Whether the way in which a pose was approached is recorded.
        load: Mass of the load that is hidden, kg.
        carries: Joint whose link carries it.
    """

    arm: Arm
    posed: int
    weight: Weight
    friction: np.ndarray
    directed: bool
    load: float
    carries: str

    @property
    def names(self) -> tuple[str, ...]:
        return self.arm.joint_names[: self.posed]

    def positions(self, seed: int, count: int, used: float = USED) -> np.ndarray:
        """Return (N, n) positions in the middle part of the ranges of the joints that are posed."""
        low, high = self.arm.range
        middle, half = 0.5 * (low + high), 0.5 * used * (high - low)
        q = np.random.default_rng(seed).uniform(middle - half, middle + half, (count, self.arm.n))
        q[:, self.posed :] = 0.0
        return q

    def record(self, seed: int, count: int, load: float = 0.0, used: float = USED) -> Recording:
        """Return what poses read, each stuck on its way."""
        random = np.random.default_rng(seed + 1000)
        q = self.positions(seed, count, used)
        way = random.choice([-1.0, 1.0], q.shape)
        stuck = way * self.friction * random.uniform(0.5, 1.0, q.shape)
        noise = NOISE * self.arm.effort_limit * random.standard_normal(q.shape)
        effort, first = self.weight(q, load) + stuck + noise, slice(self.posed)
        return Recording(
            self.names, None, q[:, first], effort=effort[:, first],
            direction=way[:, first] if self.directed else None, source=f"poses {seed}",
        )  # fmt: skip

    def left(self) -> np.ndarray:
        """(posed,) RMS of what no model can know: noise, and friction as far as it varies."""
        # Of u between 0.5 and 1: its variance where its sign is known, else its mean square.
        unknown = 1.0 / 48.0 if self.directed else 7.0 / 12.0
        variance = unknown * self.friction**2 + (NOISE * self.arm.effort_limit) ** 2
        return np.sqrt(variance)[: self.posed]


def of_plant(name: str, link: str, place: tuple[float, float, float]) -> tuple[Arm, Weight]:
    """Return an arm of the package and the weight of its plant's links, by Pinocchio."""
    plant = PlantFile.load(name)
    arm, values = plant.model.arm, plant.model.parameters()
    links = dict(plant.links)
    if carried := values.get("payload.mass"):  # the endoscope
        centre = np.array(values["payload.first_moment"]) / carried
        body = arm.body(str(values["payload.link"]))
        endoscope = pin.Inertia(carried, body.frame.actInv(centre), np.zeros((3, 3)))
        links[body.name] = links[body.name] + endoscope

    def weight(q: np.ndarray, load: float) -> np.ndarray:
        point = pin.Inertia(load, np.array(place), np.zeros((3, 3)))
        tree = build_tree(arm, {**links, link: links[link] + point}, arm.gravity)
        return np.array([tree.gravity(row) for row in q])

    return arm, weight


def ecm() -> Posed:
    """An ECM without its roll, approached from unknown directions."""
    arm, weight = of_plant("ecm", "link3", (0.05, 0.02, -0.1))
    return Posed(arm, 3, weight, np.array([0.6, 0.6, 3.0, 0.02]), False, 0.8, "insertion")


def psm() -> Posed:
    """A PSM without its instrument's joints, each pose approached in a known direction."""
    arm, weight = of_plant("psm", "link3", (0.02, 0.02, 0.1))
    friction = np.array([0.1, 0.22, 0.7, 0.0, 0.0, 0.0, 0.0])
    return Posed(arm, 3, weight, friction, True, 0.2, "insertion")


def ur5() -> Posed:
    """A UR5 whose last two joints stay where they are, approached from unknown directions."""
    arm = mujoco_arms.arm_of("ur5")
    engine = mujoco_arms.urdf(arm, np.ones(arm.n))

    def weight(q: np.ndarray, load: float) -> np.ndarray:
        still = np.zeros_like(q)
        bare = engine.torque(q, still, still)
        if not load:
            return bare
        return bare + engine.added((q, still, still), 3, load, (0.0, 0.1, 0.1))

    return Posed(arm, 4, weight, 0.02 * arm.effort_limit, False, 2.0, "wrist_1_joint")


@dataclass(frozen=True, eq=False)
class Identified:
    """An arm, what was identified from its poses, and the model's file."""

    posed: Posed
    fit: Fit
    file: Path

    @property
    def model(self) -> TorqueModel:
        return TorqueModel.load(self.file)


ARMS = {"ecm": (ecm, 80), "psm": (psm, 120), "ur5": (ur5, 120)}


@pytest.fixture(scope="module", params=ARMS)
def known(request, tmp_path_factory) -> Identified:
    make, count = ARMS[request.param]
    posed, folder = make(), tmp_path_factory.mktemp(request.param)
    posed.record(1, count).save(folder / "poses.csv")
    fit = identify(folder / "poses.csv", posed.arm)
    fit.model.save(folder / "model.yaml")
    return Identified(posed, fit, folder / "model.yaml")


def test_weight_at_poses_elsewhere_is_known_twice_as_well_as_one_pose_tells_it(known):
    q = known.posed.positions(50, 300)
    true = known.posed.weight(q, 0.0)[:, : known.posed.posed]
    error = known.model.torque(q[:, : known.posed.posed]) - true
    assert (np.sqrt(np.mean(error**2, axis=0)) < 0.5 * known.posed.left()).all()


def test_other_poses_are_off_by_no_more_than_what_sticks(known):
    found = evaluate(known.model, known.posed.record(2, 200)).joints
    rmse = np.array([found[name].rmse for name in known.posed.names])
    assert (rmse < 1.1 * known.posed.left()).all()


def test_held_out_error_is_what_other_poses_show(known):
    """Within a quarter, as slabs of few poses tell it."""
    other = evaluate(known.model, known.posed.record(3, 300)).joints
    for name, error in known.fit.held_out.items():
        assert error.rmse == pytest.approx(other[name].rmse, rel=0.25), name


def test_far_from_the_poses_the_model_is_off_by_about_as_much_as_it_says():
    posed = ecm()
    fit = identify(posed.record(1, 100, used=0.25), "ecm")
    q = posed.positions(50, 300, used=1.0)
    error = fit.model.torque(q[:, :3]) - posed.weight(q, 0.0)[:, :3]
    said = np.array([fit.holding[name].error_anywhere for name in posed.names])
    rmse = np.sqrt(np.mean(error**2, axis=0))
    assert (rmse > posed.left()).any()  # much is open there
    assert (rmse < 2.0 * said).all(), (rmse, said)


def test_the_model_has_the_arm_s_own_links_and_units(known):
    names = [one.name for one in known.fit.parameters]
    assert not any("beta" in name for name in names)
    assert known.model.term("gravity") is None
    weights = known.model.term("link_weight")
    assert weights is not None
    assert weights.carries_arm
    assert list(known.model.arm.joint_names) == list(known.posed.names)
    of = {one.name: one for one in known.fit.parameters}
    for joint in known.model.arm.joints:
        first = f"directional_cable.positive.{joint.name}"
        units = [of[f"{first}[{power}]"].unit for power in (0, 2) if f"{first}[{power}]" in of]
        slides = joint.kind == "prismatic"
        assert units == (["N", "N/m^2"] if slides else ["N·m", "N·m/rad^2"]), joint.name
    cable = known.model.parameters()
    assert cable["directional_cable.dead_band"] == pytest.approx(0.02 * known.model.arm.scale)


def test_weights_that_the_poses_determine_lie_in_their_intervals(known):
    """Every combination of the links' weights, as the plant's own efforts give it."""
    arm = known.model.arm
    q = known.posed.positions(60, 200)
    first = slice(known.posed.posed)
    directions = weight_directions(arm)
    columns = gravity_of(arm).at(q[:, first])
    true = known.posed.weight(q, 0.0)[:, first].ravel()
    theta, _, rank, _ = np.linalg.lstsq(columns.reshape(-1, columns.shape[-1]), true, rcond=None)
    assert rank == directions.shape[1]
    combinations = base_weights(arm)
    found = {one.name: one for one in known.fit.parameters}
    inside = [
        found[name].ci95[0] <= combination @ directions @ theta <= found[name].ci95[1]
        for name, _, combination in combinations
    ]
    assert np.mean(inside) >= 0.8


def test_friction_is_told_apart_where_directions_are_known_and_else_this_is_said(known):
    said = " ".join(known.fit.identifiability.statements)
    q = known.posed.positions(40, 100)[:, : known.posed.posed]
    up, down = (known.model.torque(q, direction=np.full(q.shape, way)) for way in (1.0, -1.0))
    friction = np.mean(0.5 * (up - down), axis=0)
    if known.posed.directed:
        assert known.fit.verdict.level == "good"
        assert "approached from one direction" not in said
        mean = 0.75 * known.posed.friction[: known.posed.posed]
        np.testing.assert_allclose(friction, mean, rtol=0.1)
    else:
        assert (up == down).all()
        assert f"{', '.join(known.posed.names)}: approached from one direction only" in said
        assert "cannot be separated" in said
        assert known.fit.verdict.level in ("good", "usable")


def test_an_untouched_arm_is_quiet(known):
    diagnosis = diagnose(known.posed.record(4, 200), known.model)
    assert (diagnosis.verdict, diagnosis.findings) == ("nothing_to_explain", ())


def test_a_load_is_found_and_weighed_at_other_poses(known):
    loaded = known.posed.record(5, 200, known.posed.load)
    diagnosis = diagnose(loaded, known.model)
    payload = diagnosis.findings[0]
    assert (payload.effect, payload.joints) == ("payload", (known.posed.carries,))
    # Nothing but what sticks tells how well it is known; the model's own error is a part of it.
    assert payload.parameters["mass"].value == pytest.approx(known.posed.load, rel=0.2)
    again = known.posed.record(6, 200, known.posed.load)
    errors = [evaluate(model, again).joints for model in (known.model, diagnosis.model)]
    before, after = ([one[name].rmse for name in known.posed.names] for one in errors)
    assert np.max(np.divide(before, known.posed.left())) > 1.5
    assert (np.array(after) < 1.25 * known.posed.left()).all()


def test_the_compensator_takes_the_model_and_sends_what_holds_the_links(known):
    settings = Settings.from_parameters(known.model.parameters())
    for q in known.posed.positions(70, 20):
        first = q[: known.posed.posed]
        sent = settings.torque(first, np.zeros(known.posed.posed))
        true = known.posed.weight(q[None], 0.0)[0, : known.posed.posed]
        # What friction would hold anyway.
        assert (np.abs(sent - true) < known.posed.friction[: known.posed.posed]).all()


def test_from_a_file_of_three_joints_to_a_load_on_the_command_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(in_simulation.let_go, "__defaults__", (0.1,))  # s
    posed, model, out = ecm(), tmp_path / "model.yaml", tmp_path / "diagnosis"
    for name, seed, load in (("poses", 1, 0.0), ("other", 7, 0.0), ("loaded", 8, posed.load)):
        posed.record(seed, 80, load).save(tmp_path / f"{name}.csv")
    poses, other, loaded = (str(tmp_path / f"{name}.csv") for name in ("poses", "other", "loaded"))

    assert main(["identify", poses, "--arm", "ecm", "--out", str(model)]) == 0
    shown = capsys.readouterr().out
    assert "taken to be held (rad, m): roll at 0" in shown
    assert main(["evaluate", other, "--model", str(model)]) == 0
    shown = capsys.readouterr().out
    assert "(RMSE in N)" in shown
    assert "identify's verdict, from the model file: good" in shown
    assert main(["diagnose", loaded, "--model", str(model), "--out", str(out)]) == 0
    found = json.loads((out / "findings.json").read_text())
    first = found["findings"][0]
    assert (first["effect"], first["joints"]) == ("payload", ["insertion"])
    # What a compensator does with both models is shown, though the ECM's plant has a joint more.
    assert found["simulation"]["drift"]
    assert TorqueModel.load(out / "extended_model.yaml").term("payload") is not None

    page = model.with_suffix(".html").read_text()
    assert Page(page).open == []
    for said in ("held-out RMSE, mN·m (insertion mN)", "m(link3) +1 m(link4)", "N/m^2"):
        assert said in page
    assert "beta" not in page


def test_a_joint_that_slides_is_told_in_its_own_units_where_it_was_not_posed():
    posed = ecm()
    still = posed.record(9, 60)
    position = still.position.copy()
    position[:, 2] = 0.1 + 0.004 * np.random.default_rng(9).uniform(-1.0, 1.0, 60)
    q = np.column_stack([position, np.zeros(60)])
    recording = replace(still, position=position, effort=posed.weight(q, 0.0)[:, :3])
    said = identify(recording, "ecm").identifiability.statements
    expected = "insertion was posed at 100 mm only: a constant is all of its torque"
    assert any(line.startswith(expected) for line in said)


def test_efforts_in_amperes_give_a_model_in_amperes():
    posed, gain = ecm(), 4.0  # N·m/A and N/A
    recording = posed.record(1, 80)
    currents = replace(recording, effort=recording.effort / gain, arm=None)
    fit = identify(currents, posed.arm.told_in("A", 1.0 / gain))
    assert {one.unit for one in fit.parameters if one.name.startswith("m")} == {
        "kg·A/(N·m)", "kg·m·A/(N·m)",
    }  # fmt: skip
    q = posed.positions(50, 300)
    error = gain * fit.model.torque(q[:, :3]) - posed.weight(q, 0.0)[:, :3]
    assert (np.sqrt(np.mean(error**2, axis=0)) < 0.5 * posed.left()).all()


@pytest.mark.parametrize("name", ["ecm", "psm", "ur5", "panda", "chain"])
def test_base_weights_span_what_torque_at_rest_depends_on(name):
    arm = mujoco_arms.arm_of(name)
    q = np.random.default_rng(7).uniform(*arm.range, (200, arm.n))
    whole = rigid_body.regressor(arm, q, None, None, arm.gravity).reshape(-1, len(arm.bodies), 10)
    full = whole[..., :4].reshape(len(whole), -1)
    combinations = np.array([one for _, _, one in base_weights(arm)])
    assert len(combinations) == np.linalg.matrix_rank(full, tol=1e-9 * np.linalg.norm(full))
    left = full - full @ np.linalg.pinv(combinations) @ combinations
    assert np.abs(left).max() < 1e-6 * np.abs(full).max()


@pytest.mark.parametrize("name", ["mtmr", "ecm", "psm", "ur5"])
def test_coefficients_become_parameters_of_the_same_torque(name):
    arm = mujoco_arms.arm_of(name)
    columns = gravity_of(arm)
    q = np.random.default_rng(8).uniform(*arm.range, (50, arm.n))
    theta = np.random.default_rng(9).normal(size=columns.count)
    model = TorqueModel.from_parameters({"arm": arm.source, **columns.parameters(theta)}, arm)
    expected = columns.at(q) @ theta
    np.testing.assert_allclose(model.torque_at(State(q)), expected, atol=1e-9)


def test_only_an_mtm_s_wrist_pitch_has_a_spring():
    assert gravity_of(Arm.load("mtml")).sprung == ("wrist_pitch",)
    assert gravity_of(Arm.load("psm")).sprung == ()


@pytest.mark.parametrize(("name", "expected"), [("ecm", 20), ("panda", 24)])
def test_too_few_poses_are_refused(name, expected):
    arm = mujoco_arms.arm_of(name)
    q = np.random.default_rng(0).uniform(*arm.range, (expected - 1, arm.n))
    recording = Recording(arm.joint_names, None, q, effort=np.ones(q.shape), source="few.csv")
    with pytest.raises(
        RecordingError,
        match=f"^few.csv: holds {expected - 1} static poses, expected at least {expected}$",
    ):
        identify(recording, arm)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"for_console": True}, "^--for-console: got 'ecm', expected an arm of the console"),
        ({"physical": True}, "^--physical: got True, expected trajectories: static poses"),
        ({"effects": ["payload"]}, "^--terms: got 'payload', expected no --terms with static"),
    ],
)
def test_what_poses_cannot_give_is_refused_in_one_line(options, says):
    posed = ecm()
    with pytest.raises(ConfigError, match=says) as caught:
        identify(posed.record(1, 40), posed.arm, **options)
    assert "\n" not in str(caught.value)
