"""What a diagnosis could not separate, from its findings.json to pairs that a plan separates."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import (
    CONTAINED,
    UNREADABLE_CAUSE,
    FittedHypothesis,
    MeasuredMotion,
    SignificanceSettings,
)
from dvrk_gravity.effects import ReadingErrors, State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file
from dvrk_gravity.files.entries import check_count
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning.information import noise_of
from dvrk_gravity.planning.pairs import HypothesisPair
from dvrk_gravity.planning.separation import UnresolvedPairs

ENTRY = "unseparated"
_MOST_CAUSES = 1000  # Chosen: a diagnosis names tens
_SLOW = 0.05  # rad/s, a tenth in m: a step at each reversal has no slope. As `plan` has it
_NOISE_TIME = 0.1  # s, correlation time of noise where no model states one: as `plan` has it
_STATES = 200  # at which the torques of two causes are compared: far more than parameters


class PlannedMotion(MeasuredMotion):
    """States that a plan passes: nothing was measured there."""

    def slowest(self, row: Array) -> float:
        """Return the speed below which the direction of a row of joints is uncertain, rad/s."""
        return _SLOW * self._scale(row)

    @classmethod
    def of(cls, model: TorqueModel, state: State, time: Array) -> PlannedMotion:
        """Return (N, n) states at (M,) times, s: N / M motions, or poses with a direction."""
        none, count = np.zeros_like(state.q), len(time)
        copies = len(state.q) // count
        qd = none if state.qd is None else state.qd
        static = state.direction is not None
        rate = None if static or count < 2 else (count - 1) / float(time[-1] - time[0] or 1.0)
        return cls(
            model=model, q=state.q, qd=qd, qdd=none if state.qdd is None else state.qdd,
            effort=none, direction=state.direction, time=np.tile(time, copies),
            parts=tuple(slice(k * count, (k + 1) * count) for k in range(copies)), rate=rate,
            present=np.ones(model.arm.n, dtype=bool), step=np.zeros(model.arm.n),
        )  # fmt: skip


def unresolved_pairs(
    model: TorqueModel,
    groups: Sequence[Sequence[FittedHypothesis]],
    left: Array,
    poses: bool,
    lasted: float,
) -> UnresolvedPairs:
    """Return the pairs of causes that a plan is to separate, and how well torques are known.

    Args:
        model: The model that was diagnosed.
        groups: Causes of which one is there, each time. Any two are a pair, for any may be the true
            one; but not two of the same name in findings, or where none is to be shown.
        left: (n,) RMS error that the findings leave, N·m.
        poses: Static poses were diagnosed.
        lasted: How long what was diagnosed lasts, s.
    """
    pairs = tuple(
        pair
        for group in groups
        for first, second in combinations(group, 2)
        if first.named != second.named
        if any((pair := make_pair(model, first, second)).required)
    )
    known = model.uncertainty
    if known is None:
        noise, coherent = left**2 * _NOISE_TIME, np.zeros(model.arm.n)
        noise = np.where(np.isfinite(noise) & (noise > 0.0), noise, noise_of(model.arm))
    else:  # where findings leave more than that, nothing says that less would remain elsewhere
        known = replace(known, error=np.fmax(known.error, left))
        noise = noise_of(model.arm, known)
        coherent = SignificanceSettings().coherent * np.nan_to_num(known.error)
    motion_of = partial(PlannedMotion.of, model)
    return UnresolvedPairs(model, pairs, motion_of, noise, coherent, poses, lasted)


def make_pair(
    model: TorqueModel, first: FittedHypothesis, second: FittedHypothesis
) -> HypothesisPair:
    """Return two causes, and which of them is to be shown if it is true.

    If a cause is true that another one at the same place contains, a diagnosis takes it as the
    simpler one: nothing is to be shown.
    """
    both = first, second
    either = [
        not (each.rejected or _contains(model, other, each))
        for each, other in zip(both, both[::-1], strict=True)
    ]
    return HypothesisPair(first, second, (either[0], either[1]))


def _contains(model: TorqueModel, larger: FittedHypothesis, smaller: FittedHypothesis) -> bool:
    """Return whether the torque of a cause is one of a larger one's at the same place, anywhere."""
    if larger.hypothesis.site != smaller.hypothesis.site or len(larger.theta) <= len(smaller.theta):
        return False
    arm, random = model.arm, np.random.default_rng(0)
    lower, upper = np.clip(arm.range, -np.pi, np.pi)
    q = random.uniform(lower, upper, (_STATES, arm.n))
    qd, qdd = random.normal(size=(2, _STATES, arm.n)) * arm.scale
    motion = PlannedMotion.of(model, State(q, qd, qdd), np.arange(float(_STATES)))
    columns = larger.columns(motion).reshape(-1, len(larger.theta))
    torque = (smaller.columns(motion) @ smaller.theta).ravel()
    left = torque - columns @ np.linalg.lstsq(columns, torque, rcond=None)[0]
    return bool(left @ left <= CONTAINED * (torque @ torque))


def load_unresolved(
    path: str | Path, model: TorqueModel | str | Path | None = None
) -> UnresolvedPairs:
    """Return what a diagnosis could not separate.

    Args:
        path: findings.json.
        model: The model that was diagnosed; ``None``: the file that findings.json names.

    Raises:
        ConfigError: Naming file and entry: nothing to separate, no model, or another arm's.
    """
    content = json_file.load(path)
    try:
        return _parse_unresolved(content, Path(path).parent, model)
    except ConfigError as error:
        raise error if error.source else error.in_file(path) from None


def _parse_unresolved(
    content: Mapping[str, Any], folder: Path, model: TorqueModel | str | Path | None
) -> UnresolvedPairs:
    if "verdict" not in content:
        raise ConfigError("verdict", None, "the findings.json of `diagnose`")
    entry = content.get(ENTRY)
    if not isinstance(entry, Mapping):
        expected = "what could not be separated: findings.json of a diagnosis with this version"
        raise ConfigError(ENTRY, entry, expected)
    given = _groups(entry)
    if model is None:
        model = _model_path(entry.get("model"), folder)
    tested = TorqueModel.of(model)
    # Recordings are corrected before they are diagnosed.
    tested = replace(tested, reading_errors=ReadingErrors.none(tested.arm.n))
    arm, joints = tested.arm, entry.get("joints")
    if joints != list(arm.joint_names):
        its = f"those of {arm.name}'s model: {', '.join(arm.joint_names)}"
        raise ConfigError(f"{ENTRY}.joints", joints, its)
    groups = [
        [FittedHypothesis.from_dict(each, arm, where) for each in group]
        for where, group in given.items()
    ]
    (lasted,) = _numbers([entry.get("lasted")], "lasted", 1)
    if lasted < 0.0:
        raise ConfigError(f"{ENTRY}.lasted", float(lasted), "s, 0 or more")
    errors = content.get("rmse", {}).get("after", {})
    left = np.array([errors.get(name) or np.nan for name in arm.joint_names], dtype=float)
    at_rest = State(*np.zeros((3, 2, arm.n)))  # twice, so that nothing is repeated
    motion = PlannedMotion.of(tested, at_rest, np.arange(2.0))
    for where, group in zip(given, groups, strict=True):
        for each in group:
            _require_columns(each, motion, where)
    found = unresolved_pairs(tested, groups, left, bool(entry.get("poses")), float(lasted))
    if not found.pairs:
        expected = "at least two causes that could not be separated: this diagnosis is clear"
        raise ConfigError(ENTRY, [], expected)
    return found


def _groups(entry: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return the groups of causes by their place in the file; of 0.3 and before, its pairs."""
    if "groups" in entry:
        groups = _require_list(entry["groups"], f"{ENTRY}.groups")
        found = {f"{ENTRY}.groups[{k}]": group for k, group in enumerate(groups)}
    else:
        pairs = _require_list(entry.get("pairs"), f"{ENTRY}.pairs")
        found = {f"{ENTRY}.pairs[{k}]": _of_pair(pair) for k, pair in enumerate(pairs)}
    for where, group in found.items():
        if len(_require_list(group, where)) < 2:
            raise ConfigError(where, group, "two causes or more")
    check_count(ENTRY, sum(map(len, found.values())), _MOST_CAUSES)
    return found


def _of_pair(pair: Any) -> Any:
    """Return two causes of an earlier file; one that need not be shown is one that was rejected."""
    if not isinstance(pair, Mapping):
        return pair
    between, either = pair.get("between"), pair.get("either")
    if not isinstance(between, list) or not isinstance(either, list):
        return between
    return [
        {**each, "rejected": not shown} if isinstance(each, Mapping) else each
        for each, shown in zip(between, either, strict=False)
    ]


def _require_list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise ConfigError(where, value, "a list")
    return value


def _require_columns(cause: FittedHypothesis, motion: PlannedMotion, where: str) -> None:
    """Refuse a cause whose entries do not make a torque: of a joint that is not there, say."""
    try:
        shape = cause.columns(motion).shape
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ConfigError(where, str(error), UNREADABLE_CAUSE) from error
    if shape[-1] != len(cause.theta):
        words = f"{len(cause.theta)} factors of {shape[-1]} torques"
        raise ConfigError(where, words, UNREADABLE_CAUSE)


def rediagnosis_command(
    path: str | Path, further: str, poses: bool = False, model: str | Path | None = None
) -> str:
    """Return the command that diagnoses a further recording together with the first ones.

    Args:
        path: findings.json of the first ones.
        further: The further recording, of poses or of a motion. Beside one of the other kind it is
            diagnosed alone.
        poses: Which of them.
        model: As for :func:`load_unresolved`.
    """
    entry, folder = json_file.load(path)[ENTRY], Path(path).parent
    first = [os.path.normpath(folder / each) for each in entry.get("recordings") or ()]
    recordings = (first or ["RECORDING"]) if entry["poses"] == poses else []
    its = os.path.normpath(folder / entry["model"] if model is None else model)
    of, out = " ".join(map(quote, [*recordings, further])), str(folder / "both")
    return f"dvrk_gravity diagnose {of} --model {quote(its)} --out {quote(out)}"


def _model_path(given: Any, folder: Path) -> Path:
    if not isinstance(given, str) or not given:
        raise ConfigError(f"{ENTRY}.model", given, "a model's file, or --model")
    path = folder / given
    if not Path(str(path).split("#")[0]).is_file():
        raise ConfigError(f"{ENTRY}.model", given, "a file that is there, or --model")
    return path


def _numbers(value: Any, name: str, count: int) -> np.ndarray:
    try:
        found = np.array(value, dtype=float)
    except (OverflowError, TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (count,) or not np.isfinite(found).all():
        raise ConfigError(f"{ENTRY}.{name}", value, f"{count} finite numbers")
    return found
