"""What a diagnosis could not separate, as its findings.json has it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.diagnosis.results.rivals import EXPECTED, Contest, RivalCause, RivalCauses
from dvrk_gravity.diagnosis.results.sentences import rejoining_command
from dvrk_gravity.effects import ReadingErrors, State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file
from dvrk_gravity.files.entries import check_count
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import Rival, Unseparated

ENTRY = "unseparated"
_MOST_PAIRS = 1000  # Chosen: all pairs of 45 causes


def load_unseparated(
    path: str | Path, model: TorqueModel | str | Path | None = None
) -> Unseparated:
    """Return what a diagnosis could not separate.

    Args:
        path: findings.json.
        model: The model that was diagnosed; ``None``: the file that findings.json names.

    Raises:
        ConfigError: Naming file and entry: findings of an earlier version, nothing to separate, no
            model, or another arm's.
    """
    content = json_file.load(path)
    try:
        return _unseparated(content, Path(path).parent, model)
    except ConfigError as error:
        raise error if error.source else error.in_file(path) from None


def _unseparated(
    content: Mapping[str, Any], folder: Path, model: TorqueModel | str | Path | None
) -> Unseparated:
    if "verdict" not in content:
        raise ConfigError("verdict", None, "the findings.json of `diagnose`")
    entry = content.get(ENTRY)
    if not isinstance(entry, Mapping):
        expected = "what could not be separated: findings.json of a diagnosis with this version"
        raise ConfigError(ENTRY, entry, expected)
    if entry.get("pairs") and not isinstance(entry["pairs"], list):
        raise ConfigError(f"{ENTRY}.pairs", entry["pairs"], "a list")
    if not entry.get("pairs"):
        expected = "at least two causes that could not be separated: this diagnosis is clear"
        raise ConfigError(f"{ENTRY}.pairs", [], expected)
    check_count(f"{ENTRY}.pairs", len(entry["pairs"]), _MOST_PAIRS)
    if model is None:
        model = _model_path(entry.get("model"), folder)
    tested = TorqueModel.of(model)
    # Recordings are corrected before they are diagnosed.
    tested = replace(tested, reading_errors=ReadingErrors.none(tested.arm.n))
    arm, joints = tested.arm, entry.get("joints")
    if joints != list(arm.joint_names):
        its = f"those of {arm.name}'s model: {', '.join(arm.joint_names)}"
        raise ConfigError(f"{ENTRY}.joints", joints, its)
    noise, coherent = (_numbers(entry.get(name), name, arm.n) for name in ("noise", "coherent"))
    if (noise <= 0.0).any():
        raise ConfigError(f"{ENTRY}.noise", noise.tolist(), "variances above 0")
    pairs, again = [], []
    for number, pair in enumerate(entry["pairs"]):
        where = f"{ENTRY}.pairs[{number}]"
        between = pair.get("between") if isinstance(pair, Mapping) else None
        if not isinstance(between, list) or len(between) != 2:
            raise ConfigError(f"{where}.between", between, "two causes")
        first, second = (RivalCause.from_dict(each, arm, where) for each in between)
        pairs.append(RivalCauses(first, second, _either(pair.get("either"), f"{where}.either")))
        again.append(float(_numbers([pair.get("again") or 0.0], f"pairs[{number}].again", 1)[0]))
    poses = bool(entry.get("poses"))
    (lasted,) = _numbers([entry.get("lasted")], "lasted", 1)
    if lasted < 0.0:
        raise ConfigError(f"{ENTRY}.lasted", float(lasted), "s, 0 or more")
    contest = Contest(tested, tuple(pairs), noise, coherent, poses, float(lasted), tuple(again))
    found = contest.unseparated()
    for number, rivalry in enumerate(found.rivalries):
        for rival in (rivalry.first, rivalry.second):
            _require_columns(found, rival, f"{ENTRY}.pairs[{number}].between")
    return found


def _require_columns(found: Unseparated, rival: Rival, where: str) -> None:
    """Refuse a cause whose entries do not make a torque: of a joint that is not there, say."""
    at_rest = State(*np.zeros((3, 2, found.model.arm.n)))  # twice, so that nothing is repeated
    try:
        shape = rival.columns(found.passing(at_rest, np.arange(2.0))).shape
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ConfigError(where, str(error), EXPECTED) from error
    if shape[-1] != len(rival.theta):
        raise ConfigError(where, f"{len(rival.theta)} factors of {shape[-1]} torques", EXPECTED)


def diagnosed_again(
    path: str | Path, further: str, poses: bool = False, model: str | Path | None = None
) -> str:
    """Return the command that diagnoses a further recording together with the first ones.

    Args:
        path: findings.json of the first ones.
        further: The further recording, of poses or of a motion. Beside one of the other kind it is
            diagnosed alone.
        poses: Which of them.
        model: As for :func:`load_unseparated`.
    """
    entry, folder = json_file.load(path)[ENTRY], Path(path).parent
    first = [os.path.normpath(folder / each) for each in entry.get("recordings") or ()]
    recordings = (first or ["RECORDING"]) if entry["poses"] == poses else []
    its = os.path.normpath(folder / entry["model"] if model is None else model)
    return rejoining_command([*recordings, further], its, str(folder / "both"))


def _model_path(given: Any, folder: Path) -> Path:
    if not isinstance(given, str) or not given:
        raise ConfigError(f"{ENTRY}.model", given, "a model's file, or --model")
    path = folder / given
    if not Path(str(path).split("#")[0]).is_file():
        raise ConfigError(f"{ENTRY}.model", given, "a file that is there, or --model")
    return path


def _either(value: Any, where: str) -> tuple[bool, bool]:
    if not (isinstance(value, list) and len(value) == 2 and any(value)):
        raise ConfigError(where, value, "true or false twice, one of them true")
    return bool(value[0]), bool(value[1])


def _numbers(value: Any, name: str, count: int) -> np.ndarray:
    try:
        found = np.array(value, dtype=float)
    except (OverflowError, TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (count,) or not np.isfinite(found).all():
        raise ConfigError(f"{ENTRY}.{name}", value, f"{count} finite numbers")
    return found
