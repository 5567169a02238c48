"""How a monitor names changes, tells pushes from them, and how often it is wrong about nothing.

    python benchmark/monitor.py --seeds 0 12 --hours 30 --jobs 2 --json monitor.json

Every seed draws each of the arms, identifies it from one recording, and records flights in which
something happens (testing/flights.py); of clean ones as many as make the hours together. The
monitor has the identified model. --real does the same with recordings of real arms
(``DVRK_GRAVITY_DATA``) and with real loads, and nothing else.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict

from dvrk_gravity.monitoring import monitor

from testing.flights import ARMS, BLOCK, SCENARIOS, Flight, laboratory
from testing.jobs import run_all
from testing.monitor_judge import CLEAN, Verdict, judged, table
from testing.mujoco_world import NAMES

BLOCKS = 6  # clean flights of one arm, before another one is drawn
Todo = tuple[str, int, tuple[tuple[str, int], ...]]


def run(arm: str, seed: int, flights: Sequence[tuple[str, int]]) -> list[Verdict]:
    """Identify an arm and judge what the monitor says of some flights.

    Args:
        arm: Its name.
        seed: Of the arm.
        flights: Scenario and number of each.
    """
    verdicts = []
    for scenario, number in flights:

        def fly(scenario: str = scenario, number: int = number) -> Flight:
            return laboratory(arm, seed).fly(scenario, number)

        verdicts.append(judged(fly, Verdict(arm, seed, number, scenario), monitor))
        print(verdicts[-1], file=sys.stderr, flush=True)
    return verdicts


def todo(
    arms: Sequence[str], seeds: range, scenarios: Sequence[str], hours: float, clean: str
) -> list[Todo]:
    """Return which flights are recorded of which arms.

    Args:
        arms: Their names.
        seeds: Of the arms in which something happens.
        scenarios: What happens.
        hours: Of clean flights, all arms together.
        clean: Scenario of those.
    """
    result: dict[tuple[str, int], list[tuple[str, int]]] = {}
    for seed in seeds:
        for arm in arms:
            result.setdefault((arm, seed), []).extend((scenario, 0) for scenario in scenarios)
    blocks = math.ceil(hours * 3600.0 / BLOCK / len(arms))
    for block in range(blocks):
        for arm in arms:
            seed = seeds.start + block // BLOCKS
            result.setdefault((arm, seed), []).append((clean, block % BLOCKS))
    return [(arm, seed, tuple(flights)) for (arm, seed), flights in result.items() if flights]


def main() -> int:
    """Run the flights and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    happening = [scenario for scenario in SCENARIOS if scenario not in CLEAN]
    # fmt: off
    parser.add_argument("--scenarios", nargs="*", choices=happening, default=happening,
                        metavar="SCENARIO", help=f"some of {', '.join(happening)} (default: all)")
    parser.add_argument("--arms", nargs="*", choices=("mtm", *NAMES), default=list(ARMS),
                        metavar="ARM", help="(default: %(default)s)")
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 4), metavar=("FIRST", "END"))
    parser.add_argument("--hours", type=float, default=0.0,
                        help="of clean flights, all arms together (default: %(default)s)")
    parser.add_argument("--elsewhere", action="store_true",
                        help="clean flights go where the arm was not calibrated")
    parser.add_argument("--real", action="store_true", help="recordings of real arms instead")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--json", help="write every flight here")
    # fmt: on
    args = parser.parse_args()
    if args.real:
        from monitor_real import look

        return look(monitor, args.json)
    clean = CLEAN[1] if args.elsewhere else CLEAN[0]
    flights = todo(args.arms, range(*args.seeds), args.scenarios, args.hours, clean)
    verdicts = [each for some in run_all(run, flights, args.jobs) for each in some]
    if args.json:
        with open(args.json, "w", encoding="utf-8") as stream:
            json.dump([asdict(verdict) for verdict in verdicts], stream, indent=1)
    print(table("flights", verdicts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
