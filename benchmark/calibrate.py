"""From power-on to a certificate: simulated arms drawn at random, each calibrated by itself.

    python benchmark/calibrate.py         # 20 MTMs, 5 PSMs, 5 other arms: two hours
    python benchmark/calibrate.py --arms mtmr psm --count 2 --time 10

Each arm has other masses, friction, cables, zeros of its joints and mounting than the model that
it is planned with (`draw_arm`). It is moved, identified, checked on a second motion, diagnosed,
moved again where that is needed, and released at 20 poses that nothing was fitted on, with a tenth
of its friction. Rehearsals are left out: there is nothing to meet.

Targets: 95 % of the arms drift by less than 0.5 deg in 10 s at all poses; no command, at 1 kHz, is
beyond a limit, and no measurement beyond a stop; at most ten minutes of motion each.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import (
    CalibrationSettings,
    Pages,
    SimulatedRig,
    Work,
    calibrate,
    draw_arm,
    largest_drift,
)
from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.files import json_file
from dvrk_gravity.planning import PlanLimits
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import (
    certificate_page,
    diagnosis_page,
    identification_page,
    plan_picture,
)
from dvrk_gravity.simulate import PlantFile
from testing.mujoco_arms import FILES

COUNTS = {"mtmr": 20, "psm": 5, "ur5": 1, "ur10": 1, "panda": 1, "kinova": 1, "chain": 1}
HOLD, LONGEST = 0.95, 10.0


def calibrated(name: str, seed: int, settings: CalibrationSettings, folder: Path) -> dict[str, Any]:
    """Calibrate one arm, and return what came of it."""
    arm = Arm.load(FILES.get(name, name))
    rig = SimulatedRig(draw_arm(PlantFile.of(arm), seed), seed, settings.friction)
    pages = Pages(
        plan_picture, identification_page, diagnosis_page, partial(certificate_page, arm=arm)
    )
    begin = time.process_time()
    work = Work(
        folder, {"--arm": name, "--seed": str(seed)}, arm, PlanLimits.of(arm), rig, pages,
        f"/{name.upper()}", seed, settings, report=lambda line: print(f"    {line}", flush=True),
    )  # fmt: skip
    certificate = calibrate(work)
    release = json_file.load(folder / "release.json")
    worst = [float(np.max(np.array(way) / arm.scale)) for way in release["drift"]]
    beyond = 0
    for bag in ("motion", "second", "further_1", "further_2"):
        if (folder / bag).exists():
            q = Recording.load(folder / bag).position
            beyond += int(((q < arm.lower) | (q > arm.upper)).any(axis=1).sum())
    return {
        "arm": name, "seed": seed, "certified": certificate["certified"],
        "reasons": certificate["reasons"], "poses": len(worst),
        "within": sum(each <= settings.max_drift for each in worst),
        "drift": max(worst, default=float("inf")), "beyond": beyond,
        "used": certificate["motion"]["used"], "commands": certificate["motion"]["commands"],
        "minutes": certificate["motion"]["seconds"] / 60.0,
        "further": sum((folder / f"further_{k}").exists() for k in (1, 2)),
        "seconds": time.process_time() - begin,
    }  # fmt: skip


def line_of(found: dict[str, Any]) -> str:
    """Return what came of one arm: certified or why not, poses, limits, motion."""
    good = "certified" if found["certified"] else f"refused ({'; '.join(found['reasons'])})"
    return (
        f"{found['arm']} {found['seed']}: {good}; "
        f"{found['within']} of {found['poses']} poses held, drift {largest_drift(found['drift'])}; "
        f"{found['beyond']} samples beyond a stop, {found['commands']} commands within all limits "
        f"(at most {100 * found['used']:.1f} % of one); {found['minutes']:.1f} min of motion, "
        f"{found['further']} further motions; {found['seconds']:.0f} s of a core"
    )


def main(given: Sequence[str] | None = None) -> int:
    """Print a line for each arm and the shares; status 1 if one misses its target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--arms", nargs="+", choices=list(COUNTS), default=list(COUNTS))
    parser.add_argument("--count", type=int, help="arms of each kind (default: as above)")
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--time", type=float, default=60.0,
                        help="as of `calibrate --time`")  # fmt: skip
    parser.add_argument("--keep", type=Path, help="folder for all files")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args(given)
    settings = CalibrationSettings(search=round(10.0 * arguments.time), rehearsal=False)
    found, failed = [], 0
    for name in arguments.arms:
        count = arguments.count or COUNTS[name]
        for seed in range(arguments.first, arguments.first + count):
            with tempfile.TemporaryDirectory() as scratch:
                folder = Path(scratch)
                if arguments.keep is not None:
                    folder = arguments.keep / f"{name}_{seed}"
                    folder.mkdir(parents=True, exist_ok=True)
                try:
                    each = calibrated(name, seed, settings, folder)
                except DvrkGravityError as error:
                    failed += 1
                    print(f"{name} {seed}: {error}", flush=True)
                    continue
            found.append(each)
            print(line_of(each), flush=True)
            if arguments.json is not None:
                arguments.json.write_text(json.dumps(found, indent=1) + "\n")
    total = len(found) + failed
    holds = sum(each["poses"] > 0 and each["within"] == each["poses"] for each in found)
    poses, within = (sum(each[name] for each in found) for name in ("poses", "within"))
    good = (
        bool(found) and holds >= HOLD * total and not any(each["beyond"] for each in found)
        and all(each["minutes"] <= LONGEST for each in found)
    )  # fmt: skip
    print(
        f"{sum(each['certified'] for each in found)} of {total} certified; {holds} of {total} hold "
        f"themselves at all poses (target {100 * HOLD:g} %), {within} of {poses} poses; "
        f"{sum(each['beyond'] for each in found)} samples beyond a stop; at most "
        f"{max((each['minutes'] for each in found), default=0.0):.1f} min of motion"
    )
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
