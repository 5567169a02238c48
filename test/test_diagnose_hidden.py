"""Hide an effect in a simulated arm, and require its name, its joint, its size and the gain."""

from __future__ import annotations

from functools import lru_cache, reduce

import numpy as np
import pytest

from dvrk_gravity.diagnosis import Diagnosis, diagnose
from dvrk_gravity.recording import Recording
from testing.hide import HIDERS, STREAMS, Hidden, hide
from testing.world import COARSE, World

RATE = 100.0  # Hz
DURATION = 10.0  # s
# A push may come as late as 18 s; the longer, the harder it is to find nothing.
LONGER = {"contact": 20.0, "nothing": 12.0}
SEED = 7
# What an effect's parameters may be off: the wider of this and its own 95 % interval.
TOLERANCE = 0.10
NAMED = sorted(set(HIDERS) - {"nothing", "outside"})


def diagnosed(effect: str, seed: int = SEED) -> tuple[Hidden, Diagnosis]:
    """Hide an effect in an arm; return what was hidden, and what the arm's model finds."""
    known = World.draw(seed, step=COARSE)
    random = np.random.default_rng([seed, STREAMS[effect]])
    world, hidden = hide(known, effect, random)
    motion, noise = (int(n) for n in random.integers(1 << 30, size=2))
    if world.readings:  # in each the arm moves alike
        recording = reduce(lambda recording, read: read(recording), world.readings, moved(seed))
    else:
        recording = world.record(motion, noise, LONGER.get(effect, DURATION), RATE)
    return hidden, diagnose(recording, known.model())


@lru_cache
def moved(seed: int) -> Recording:
    """Return what right readings tell of an arm in which nothing is hidden."""
    return World.draw(seed, step=COARSE).record(1, 2, DURATION, RATE)


@pytest.fixture(scope="module", params=NAMED)
def case(request) -> tuple[str, Hidden, Diagnosis]:
    """Return an effect, what of it was hidden, and the diagnosis."""
    return request.param, *diagnosed(request.param)


def claims(diagnosis: Diagnosis) -> list[tuple[str, tuple[str, ...]]]:
    """Return every effect and its joints that a diagnosis names, alternatives included."""
    return [
        (claim.effect, tuple(claim.joints))
        for finding in diagnosis.findings
        for claim in (finding, *finding.alternatives)
    ]


def test_a_hidden_effect_is_named_with_its_joint(case):
    effect, hidden, diagnosis = case

    assert (effect, hidden.joints) in claims(diagnosis)
    assert diagnosis.findings[0].effect == effect or diagnosis.verdict == "ambiguous"


def test_its_size_is_right(case):
    effect, hidden, diagnosis = case
    finding = next((f for f in diagnosis.findings if f.effect == effect), None)
    if finding is None:
        pytest.skip("listed as an alternative only: it has no estimate of its own")

    for name in hidden.parameters.keys() & finding.parameters.keys():
        truth, found = hidden.parameters[name], finding.parameters[name]
        near = abs(found.value - truth) <= TOLERANCE * abs(truth)
        assert near or found.low <= truth <= found.high, name


def test_it_brings_most_of_the_attainable_gain(case):
    _, _, diagnosis = case
    before = np.array(list(diagnosis.before.values()))
    after = np.array(list(diagnosis.after.values()))
    floor = np.array(list(diagnosis.floor.values()))

    joint = int(np.argmax(before / floor))

    assert before[joint] - after[joint] >= 0.8 * (before[joint] - floor[joint])


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]
)
def test_it_is_silent_where_nothing_is_hidden(seed):
    _, diagnosis = diagnosed("nothing", seed)

    assert diagnosis.verdict == "nothing_to_explain"
    assert diagnosis.findings == ()


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_what_has_no_name_is_called_unknown(seed):
    hidden, diagnosis = diagnosed("outside", seed)

    assert diagnosis.verdict in ("unexplained", "partly_explained")
    assert {f.joints for f in diagnosis.findings if f.effect == "unknown"} >= {hidden.joints}


def test_two_effects_at_once_are_both_found():
    known = World.draw(3, step=COARSE)
    random = np.random.default_rng(3)
    world, first = hide(known, "coulomb_friction", random)
    world, second = hide(world, "payload", random)

    diagnosis = diagnose(world.record(11, 12, DURATION, RATE), known.model())

    # A weight on the axis of wrist_platform is on the forearm as well as on the platform.
    assert {(first.effect, first.joints), (second.effect, second.joints)} <= set(claims(diagnosis))
    assert {f.effect for f in diagnosis.findings} == {first.effect, second.effect}


def test_static_poses_show_a_base_that_is_tilted():
    known = World.draw(4, step=COARSE)
    world, hidden = hide(known, "base_tilt", np.random.default_rng(4))

    diagnosis = diagnose(world.record_poses(5, 6, count=90), known.model())

    tilt = diagnosis.findings[0]
    assert tilt.effect == "base_tilt"
    assert tilt.parameters["roll"].value == pytest.approx(hidden.parameters["roll"], abs=0.005)
    assert tilt.parameters["pitch"].value == pytest.approx(hidden.parameters["pitch"], abs=0.005)
