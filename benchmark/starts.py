"""How far a start moves the arm: simulated starts with the shipped plant's noise.

    PYTHONPATH=. python benchmark/starts.py [--starts N] [--json FILE]

Each holds a pose near one of three, starts the compensator at 200 messages a second, and watches
for two seconds: the start's tenth of a second, the ramp, and one more. Status 1 if any joint moves
by more than 2 deg.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))

from test_start import largest_motion

from dvrk_gravity.files import text_file

TARGET = 2.0  # deg


def main() -> int:
    """Print the figures; status 1 if the target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    moved = np.array([largest_motion(1000 + seed, 200) for seed in range(arguments.starts)])
    figures = {"median": float(np.median(moved)), "worst": float(moved.max())}
    print(f"{arguments.starts} starts: the joint that moves most, deg")
    print("".join(f"  {name} {value:.2f}" for name, value in figures.items()))
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(figures, indent=1) + "\n")
    return 0 if figures["worst"] <= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
