"""Try the compensator's safety properties on as many random cases as asked for.

    PYTHONPATH=. python benchmark/supervisor_properties.py [--cases N] [--seed K] [--json FILE]

The properties are those of the tests (``test_supervisor_rules.py``, ``test_limits.py``
and ``test_terms.py``), which try a few hundred cases each; here every one gets N. A case of
``any sequence`` is up to 60 events, one of ``long sequence`` 300: messages good and bad, silences,
changes of parameters, switching on and off. A property that fails prints its smallest case,
and the exit status is 1. N cases of everything take about N / 50 seconds.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))

import test_limits
import test_terms

from testing import supervisor_judge as sequences


@hypothesis.given(st.integers(0, len(sequences.SETTINGS) - 1), sequences.SEQUENCES)
def any_sequence(start: int, sequence: list[tuple]) -> None:
    """Play a sequence that hypothesis makes up."""
    sequences.judge(start, sequence)


HYPOTHESIS: dict[str, Callable[..., None]] = {
    "any sequence": any_sequence,
    "clip within both boxes": test_limits.test_a_clipped_torque_is_within_both_boxes,
    "slew within its step": test_limits.test_no_joint_changes_by_more_than_its_step,
    "slew within limits": test_limits.test_between_two_commands_within_limits_every_command_is,
    "friction dissipates": test_terms.test_coulomb_friction_never_gives_power_back,
    "compensation below friction": (
        test_terms.test_compensation_never_pushes_with_more_power_than_friction_takes
    ),
}


def try_hypothesis(test: Callable[..., None], cases: int, seed: int) -> None:
    """Run a hypothesis test with other settings than its own."""
    many = hypothesis.settings(
        max_examples=cases,
        deadline=None,
        database=None,
        derandomize=False,
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    hypothesis.seed(seed)(many(test))()


def try_long_sequences(cases: int, seed: int) -> dict[str, int]:
    """Play random sequences in which commands are the rule; return what happened."""
    counts = {"messages": 0, "commands": 0, "holds": 0}
    for case in range(cases):
        rng = np.random.default_rng([seed, case])
        events = sequences.random_sequence(rng, 300)
        try:
            judge = sequences.judge(int(rng.integers(len(sequences.SETTINGS))), events)
        except AssertionError:
            print(f"long sequence {case} of seed {seed}:", file=sys.stderr)
            raise
        for name in counts:
            counts[name] += getattr(judge, name)
    return counts


def run(cases: int, seed: int) -> list[dict[str, Any]]:
    """Try every property; return a row for each."""
    attempts: dict[str, Callable[[], Any]] = {
        name: lambda test=test: try_hypothesis(test, cases, seed)
        for name, test in HYPOTHESIS.items()
    }
    attempts["long sequence"] = lambda: try_long_sequences(cases, seed)
    rows = []
    print(f"{'property':<30}{'cases':>10}{'seconds':>10}  result")
    for name, attempt in attempts.items():
        begin = time.perf_counter()
        row: dict[str, Any] = {"property": name, "cases": cases, "held": True}
        try:
            row |= attempt() or {}
        except Exception:
            traceback.print_exc()
            row["held"] = False
        row["seconds"] = round(time.perf_counter() - begin, 1)
        rows.append(row)
        told = ", ".join(f"{row[key]} {key}" for key in ("messages", "commands", "holds")
                         if key in row)  # fmt: skip
        result = "holds" if row["held"] else "FAILS"
        print(f"{name:<30}{cases:>10}{row['seconds']:>10.1f}  {result} {told}", flush=True)
    return rows


def main() -> int:
    """Parse the command line, run, report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=30_000, help="cases of every property")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the rows there, too")
    arguments = parser.parse_args()
    rows = run(arguments.cases, arguments.seed)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")
    return 0 if all(row["held"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
