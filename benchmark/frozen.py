"""A judge that stays the same: recordings made once, and what two states of the code answer.

    python benchmark/frozen.py make out/frozen
    python benchmark/frozen.py judge out/frozen before.json
    python benchmark/frozen.py compare before.json after.json

For a change that is to leave the judgement alone. `make` draws arms, identifies them, hides effects
in other recordings (as lab_trials.py, and real_trials.py where real data are), and keeps the models
and recordings as files. `judge` identifies each calibration again, and diagnoses each recording
with the model kept. `compare` says which answers differ.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any

import lab_trials
import numpy as np
import real_trials

from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing import hide, lab_effects
from testing.hidden_parts import Hidden
from testing.jobs import run_all
from testing.lab_outside import OUTSIDE
from testing.score import Outcome, run_trial
from testing.session import Laboratory

SEED = 41_000  # no other trial's
SIZES = (2.0, 6.0)
ARMS = ("mtmr", "panda", "ur10", "psm", "kinova")  # the first in our simulator, others in MuJoCo
CLEAN = 4


def laboratories(real: bool) -> Iterator[tuple[str, Laboratory]]:
    """Yield name and laboratory of each arm; effects take turns, so that two arms have each."""
    for number, arm in enumerate(ARMS):
        seed = SEED + number
        known = hide.HIDERS if number == 0 else {**lab_effects.HIDERS, **OUTSIDE}
        names = [name for name in known if name not in ("nothing", "outside")]
        effects = ["nothing"] * CLEAN + (names if number == 0 else names[number % 2 :: 2])
        if number == 0:
            yield arm, lab_trials.our_laboratory(seed, effects, False)
        else:
            yield arm, lab_trials.mujoco_laboratory(arm, seed, effects, SIZES, False)
    for name in real_trials.CASES if real else ():
        case = real_trials.CASES[name]()
        names = [name for name in lab_effects.HIDERS if name != "nothing"]
        each = partial(real_trials.trials, case, names[::3], 1)
        yield (
            f"real_{name}",
            Laboratory(case.arm, case.calibration, each, case.calibration.coordinates),
        )


def save(recording: Recording, path: Path, **more: Any) -> None:
    """Write a recording's arrays."""
    arrays = {
        name: getattr(recording, name)
        for name in ("time", "position", "velocity", "effort", "direction")
        if getattr(recording, name) is not None
    }
    about = {"joints": list(recording.joints), "coordinates": recording.coordinates, **more}
    np.savez_compressed(path, about=json.dumps(about, default=float), **arrays)


def load(path: Path, model: TorqueModel) -> tuple[Recording, dict[str, Any]]:
    """Return a recording of a model's arm, and what was written with it."""
    with np.load(path) as content:
        about = json.loads(str(content["about"]))
        arrays = {name: content[name] for name in content.files if name != "about"}
    return Recording(
        tuple(about["joints"]), arrays.get("time"), arrays["position"], arrays.get("velocity"),
        arrays.get("effort"), direction=arrays.get("direction"),
        coordinates=about["coordinates"], source=path.stem, arm=model.arm,
    ), about  # fmt: skip


def make(folder: Path) -> None:
    """Make all recordings."""
    for name, laboratory in laboratories(real_trials.DATA.is_dir()):
        own = folder / name
        own.mkdir(parents=True)
        model = identify(laboratory.calibration, laboratory.arm, laboratory.coordinates).model
        model.save(own / "model.yaml")
        save(laboratory.calibration, own / "calibration.npz")
        for number, (effect, seed, record) in enumerate(laboratory.trials(model)):
            recording, hidden, ratio = record()
            about = {"effect": effect, "seed": seed, "hidden": asdict(hidden), "ratio": ratio}
            save(recording, own / f"{number:02d}_{effect}.npz", **about)
        print(name, number + 1, flush=True)


def judged(folder: Path) -> dict[str, Any]:
    """Return an arm's answers: held-out error, processor's seconds, and each outcome."""
    model = TorqueModel.load(folder / "model.yaml")
    recording, about = load(folder / "calibration.npz", model)
    start = time.process_time()
    fit = identify(recording, model.arm, about["coordinates"])
    answers: dict[str, Any] = {
        "identify": {
            "nrmse": {joint: error.nrmse for joint, error in fit.held_out.items()},
            "seconds": time.process_time() - start,
        }
    }
    start = time.process_time()
    for path in sorted(folder.glob("[0-9]*.npz")):
        recording, about = load(path, model)
        hidden = Hidden(**{f.name: about["hidden"][f.name] for f in fields(Hidden)})
        hidden = Hidden(hidden.effect, tuple(hidden.joints), hidden.parameters)
        outcome = Outcome("frozen", folder.name, about["seed"], about["effect"])
        run_trial(outcome, lambda r=recording, h=hidden, a=about: (r, h, a["ratio"]), model)
        print(outcome, file=sys.stderr, flush=True)
        answers[path.stem] = asdict(outcome)
    answers["diagnose"] = {"seconds": time.process_time() - start}
    return answers


def judge(folder: Path, out: Path, jobs: int, arms: list[str] | None) -> None:
    """Judge every arm's recordings."""
    found = [own for own in sorted(folder.iterdir()) if not arms or own.name in arms]
    results = run_all(judged, [(own,) for own in found], jobs)
    answers = dict(zip([own.name for own in found], results, strict=True))
    out.write_text(json.dumps(answers, indent=1, default=float))


def wrongly_certain(outcome: Mapping[str, Any]) -> bool:
    """Whether a cause that is not there was named for certain."""
    sure = any(
        certain and not name.startswith("unknown")
        for name, certain in zip(outcome["found"], outcome["certain"], strict=True)
    )
    return sure and outcome["place"] in ("wrong", "alarm")


def compare(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Return what differs, and the counts of both."""
    lines = []
    counts = [dict.fromkeys(("first", "listed", "alarms", "certain and wrong"), 0) for _ in "12"]
    hidden = 0
    for arm in sorted(before.keys() & after.keys()):
        for name, old in before[arm].items():
            new = after[arm][name]
            if "place" not in old:
                if "nrmse" in old:
                    was, now = (np.mean(list(each["nrmse"].values())) for each in (old, new))
                    lines.append(f"{arm}: held-out error {now / was:.4f} times as before")
                seconds = f"{new['seconds']:.1f} s, before {old['seconds']:.1f}"
                lines.append(f"{arm}: {name} took {seconds}")
                continue
            hidden += old["effect"] not in ("nothing", *OUTSIDE)
            for count, each in zip(counts, (old, new), strict=True):
                count["first"] += each["place"] == "first"
                count["listed"] += each["place"] in ("first", "alternative")
                count["alarms"] += each["place"] == "alarm"
                count["certain and wrong"] += wrongly_certain(each)
            keys = ("place", "verdict", "found", "certain", "failure")
            if any(old[key] != new[key] for key in keys):
                told = " ".join(
                    f"{each['place']} {each['verdict']}: {each['found']} {each['certain']}"
                    f"{each['failure'][-200:]} {sign}"
                    for each, sign in ((old, "->"), (new, ""))
                )
                lines.append(f"{arm} {name} x{old['ratio']:.1f} {old['joints']}: {told}")
    for when, count in zip(("before", "after"), counts, strict=True):
        lines.append(f"{when}: {hidden} hidden; {count}")
    return "\n".join(lines)


def main() -> int:
    """Make, judge or compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("make").add_argument("folder", type=Path)
    judging = verbs.add_parser("judge")
    judging.add_argument("folder", type=Path)
    judging.add_argument("out", type=Path)
    judging.add_argument("--jobs", type=int, default=2, help="processes")
    judging.add_argument("--arms", nargs="*", help="only these")
    comparing = verbs.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    args = parser.parse_args()
    if args.verb == "make":
        make(args.folder)
    elif args.verb == "judge":
        judge(args.folder, args.out, args.jobs, args.arms)
    else:
        print(compare(*(json.loads(path.read_text()) for path in (args.before, args.after))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
