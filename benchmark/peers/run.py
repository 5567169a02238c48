"""This package beside others that identify arms, on the same recordings: docs/peers.md.

    make peers                  # or, after it: python benchmark/peers/run.py [--quick]
    python benchmark/peers/run.py --ours-again out/bench/peers.json

Writes every case into a folder, runs every method on it in a process of its own (peers in the
environment of benchmark/peers/requirements.lock), and prints and writes the tables. ``--quick``:
two arms and no diagnosis, printed only. ``--ours-again``: this package alone, beside the peers'
figures of an earlier run.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from cases import SEED, Prepared, forward, laboratory, low_pass, real
from exchange import BEGIN, END
from outcome import METHODS, US, Outcome, Row
from page import page

from dvrk_gravity.files import text_file

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
PAGE = REPOSITORY / "docs" / "peers.md"
PEERS = REPOSITORY / ".venv-peers" / "bin" / "python"
SCRIPTS = {US: "ours.py", "least squares": "least_squares.py", "figaroh": "with_figaroh.py",
           "figaroh LMI": "with_figaroh.py lmi", "mujoco.sysid": "with_mujoco.py"}  # fmt: skip
EDGE = 0.5  # s at both ends that no error counts, where filters begin
CONSISTENT = -1e-7  # of the greatest eigenvalue: what solvers of the inequality leave
LIMIT = 1800.0  # s, of one process


def prepared(folder: Path, quick: bool) -> Iterator[Prepared | str]:
    """Yield the cases, or a line that says what is left out."""
    yield laboratory(folder / "UR5", "ur5", SEED, diagnose=not quick)
    yield forward(folder / "UR5_MuJoCo_friction", "ur5", "friction", SEED)
    if quick:
        return
    yield forward(folder / "UR5_flexible_joint", "ur5", "flexible", SEED)
    yield forward(folder / "UR5_backlash", "ur5", "backlash", SEED)
    yield laboratory(folder / "UR5_four_minutes", "ur5", SEED, rate=1000.0, duration=240.0)
    yield laboratory(folder / "Panda", "panda", SEED + 1)
    yield laboratory(folder / "MTM", "mtmr", SEED + 2)
    yield from real(folder)


def output(case: Prepared, method: str) -> Path:
    """Return where a method writes its results, without the ending of the name."""
    return case.case.folder / method.replace(" ", "_").replace(".", "_")


def tried(case: Prepared, method: str, peers: Path) -> Outcome:
    """Run a method on a case and score it."""
    script, *flags = SCRIPTS[method].split()
    ours = method == US
    out = output(case, method)
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = str(REPOSITORY) if ours else ""
    environment["PYTHONDONTWRITEBYTECODE"] = ""  # modules are compiled once, as installed ones are
    command = [sys.executable if ours else str(peers), str(HERE / script)]
    command += [str(case.case.folder), str(out), *flags]
    try:
        process = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        return Outcome(failure=f"no answer within {LIMIT:g} s")
    path = out.with_suffix(".json")
    if not path.is_file():
        return Outcome(failure=(process.stderr.strip().splitlines() or ["ended"])[-1])
    return scored(case, json.loads(path.read_text()), out.with_suffix(".npz"))


def scored(case: Prepared, result: dict, arrays: Path) -> Outcome:
    """Return what the tables show of a result."""
    if "failure" in result and not arrays.is_file():
        return Outcome(failure=result["failure"])
    found = np.load(arrays)
    if not np.isfinite(found["torque"]).all():
        return Outcome(failure="torques that are not finite")
    known = [p for p in result["parameters"] if p["truth"] is not None]
    finite = [p for p in known if np.isfinite(p["half"])]
    bodies = result["bodies"].values()
    return Outcome(
        errors=error(case, found["torque"], case.effort),
        known=_mean(case, found["torque"], case.true_effort),
        holding=_mean(case, found["holding"], case.true_holding),
        cpu=result["cpu"],
        gib=result["gib"],
        held=(
            sum(abs(p["value"] - p["truth"]) <= p["half"] for p in finite),
            len(finite),
            len(known),
        ),
        bodies=(sum(value > CONSISTENT for value in bodies), len(bodies)),
        without_bodies=result["without_bodies"],
        diagnoses=result.get("diagnoses", []),
        failure=result.get("failure", ""),
    )


def error(case: Prepared, torque: np.ndarray, effort: np.ndarray) -> list[float]:
    """Return (n,) RMS of a difference over that of the torque, below 8 Hz."""
    edge = int(EDGE * case.case.rate)
    slow = [low_pass(values, case.case.rate)[edge:-edge] for values in (torque - effort, effort)]
    left, all_ = (np.sqrt(np.mean(values**2, axis=0)) for values in slow)
    return [float(value) for value in left / np.maximum(all_, 1e-300)]


def _mean(case: Prepared, torque: np.ndarray, truth: np.ndarray | None) -> float | None:
    if truth is None:
        return None
    shares = np.array(error(case, torque, truth))
    # A vertical first axis carries no weight: there is nothing to be a part of.
    carries = np.sqrt(np.mean(truth**2, axis=0)) > 1e-6
    return float(shares[carries].mean())


def user_lines(script: str) -> int:
    """Return the lines between the markers of a method's file, without blanks and comments."""
    text = (HERE / script.split()[0]).read_text()
    inside = text[text.index(BEGIN) + len(BEGIN) : text.index(END)]
    skipped = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
               tokenize.ENDMARKER)  # fmt: skip
    lines: set[int] = set()
    last = tokenize.NEWLINE
    closed = inside.rstrip() + "\n"
    for token in tokenize.generate_tokens(io.StringIO(closed).readline):
        docstring = token.type == tokenize.STRING and last in skipped
        if token.type not in skipped and not docstring:
            lines.update(range(token.start[0], token.end[0] + 1))
        if token.type not in (tokenize.COMMENT, tokenize.NL):
            last = token.type
    return len(lines)


def _versions(peers: Path) -> str:
    script = (
        "from importlib.metadata import version\n"
        "print(', '.join(f'{n} {version(n)}' for n in ('pin', 'figaroh', 'mujoco')))"
    )
    return subprocess.run(
        [str(peers), "-c", script], capture_output=True, text=True, check=True
    ).stdout.strip()


def described(versions: str, load: float, again: bool) -> str:
    """Return how the page came to be; ``again``: the peers' figures are of an earlier run."""
    apart = (
        "The peers' are from an earlier run on the same recordings, at another load, which may "
        "have cost them up to a third more."
        if again
        else "Compare their ratios."
    )
    return (
        f"Written by `make peers` (seed {SEED}); peers: {versions}. Processor times are from a "
        f"machine of {os.cpu_count()} cores at a mean load of {load:.0f}. {apart}"
    )


def main() -> int:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    some = parser.add_mutually_exclusive_group()
    some.add_argument("--quick", action="store_true", help="two arms, no diagnosis, no page")
    some.add_argument("--ours-again", type=Path, metavar="FILE",
                      help="run this package alone; the peers' figures are FILE's")  # fmt: skip
    parser.add_argument("--peers", type=Path, default=PEERS,
                        help="Python of the peers' environment")  # fmt: skip
    parser.add_argument("--page", type=Path, default=PAGE, help="where the tables go")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    if not arguments.peers.exists():
        print(f"{arguments.peers}: no such file, expected the peers' Python: run `make peers` once")
        return 2
    lines = {method: user_lines(script) for method, script in SCRIPTS.items()}
    kept: dict[tuple[str, str], Outcome] = {}
    if arguments.ours_again is not None:
        for row in json.loads(arguments.ours_again.read_text())["rows"]:
            kept |= {(row["name"], method): Outcome(**outcome)
                     for method, outcome in row["outcomes"].items() if method != US}  # fmt: skip
    rows: list[Row] = []
    notes: list[str] = []
    loads: list[float] = []
    with TemporaryDirectory() as folder:
        for case in prepared(Path(folder), arguments.quick):
            if isinstance(case, str):
                notes.append(case)
                continue
            outcomes = {}
            for method in METHODS:
                before = kept.get((case.name, method))
                outcome = before or tried(case, method, arguments.peers)
                outcomes[method] = outcome
                loads.append(os.getloadavg()[0])
                mean = np.mean(outcome.errors) if outcome.errors else np.nan
                print(f"{case.name}, {method}: {mean:.3f}, {outcome.cpu:.1f} s {outcome.failure}",
                      file=sys.stderr, flush=True)  # fmt: skip
            hidden = [(h.effect, h.joints[0] if h.joints else "") for h in case.hidden]
            rows.append(Row(case.name, case.what, case.case.joints, hidden, outcomes))
    how = described(_versions(arguments.peers), float(np.mean(loads)), bool(kept))
    if arguments.json is not None:
        figures = {
            "rows": [asdict(row) for row in rows],
            "lines": lines,
            "notes": notes,
            "how": how,
        }
        text_file.write(arguments.json, json.dumps(figures, indent=1) + "\n")
    text = page(rows, lines, notes, how)
    print(text)
    if not arguments.quick:
        text_file.write(arguments.page, text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
