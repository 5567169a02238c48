"""Turn round operators, signs and comparisons, one at a time, and say which ones the tests notice.

    python benchmark/mutants.py --seed 1 --json out/bench/mutants.json

Draws two places each in twenty modules of the rooms that matter (``ROOMS``): ``+`` becomes ``-``,
``<`` becomes ``>``, ``and`` becomes ``or``, a sign is left out. Each mutant lies in a copy of the
repository, and is judged by those computing tests that reach its line (test/, without live ones
and trials), quickest first, until one fails. Which tests reach a line is measured once, by
coverage.py: that run takes some three times as long as the tests alone.

A place that does not matter (the order of a sum of equal parts, a comparison that only saves time)
stays unnoticed rightly: the places that lived are listed, to be read.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import SimpleQueue

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]
ROOMS = ("compensate", "effects", "estimation", "observation", "diagnosis")
MODULES, PLACES = 20, 2
WANTED = 34 / 40
LINES, TIMES = ".coverage", "times.xml"
# s for the tests of one mutant, of a processor and of the wall: what never ends is noticed, too.
LONGEST, PATIENCE = 600, 3600.0

SWAPS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One place that is turned round.

    Attributes:
        module: Path in the repository.
        first: First line of the expression.
        last: Last line of it.
        before: The expression.
        after: What it becomes.
        source: The module with it.
    """

    module: str
    first: int
    last: int
    before: str
    after: str
    source: str


@dataclass(frozen=True)
class Verdict:
    """What the tests make of a mutant: how many reach it, and which one notices it first."""

    place: str
    before: str
    after: str
    tests: int
    noticed_by: str


def turned(node: ast.AST) -> ast.expr | None:
    """Return an expression turned round, ``None`` where there is nothing to turn."""
    match node:
        case ast.BinOp(left, op, right) if type(op) in SWAPS:
            if any(
                isinstance(part, ast.JoinedStr | ast.List | ast.Tuple) for part in (left, right)
            ):
                return None
            return ast.BinOp(left, SWAPS[type(op)](), right)
        case ast.Compare(left, [op, *rest], others) if type(op) in SWAPS:
            return ast.Compare(left, [SWAPS[type(op)](), *rest], others)
        case ast.BoolOp(op, values):
            return ast.BoolOp(SWAPS[type(op)](), values)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            return operand
    return None


class _At(ast.NodeTransformer):
    """Turns round the expression that is the n-th of a walk."""

    def __init__(self, place: ast.AST) -> None:
        self.place = place

    def generic_visit(self, node: ast.AST) -> ast.AST:
        if node is self.place:
            changed = turned(node)
            assert changed is not None
            return ast.copy_location(changed, node)
        return super().generic_visit(node)


def _places(node: ast.AST, in_function: bool = False) -> Iterator[ast.AST]:
    """Yield what can be turned round in functions, but for messages and annotations."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, ast.Raise | ast.JoinedStr):
                continue
            inside = in_function or isinstance(child, ast.FunctionDef)
            if inside and turned(child) is not None:
                yield child
            yield from _places(child, inside)


def draw(seed: int) -> list[Mutant]:
    """Draw the mutants of a seed."""
    random = np.random.default_rng(seed)
    sources = {
        path: path.read_text(encoding="utf-8")
        for room in ROOMS
        for path in sorted((REPOSITORY / "dvrk_gravity" / room).rglob("*.py"))
    }
    counts = {path: len(list(_places(ast.parse(text)))) for path, text in sources.items()}
    many = [path for path, count in counts.items() if count >= PLACES]
    chosen = [many[k] for k in sorted(random.choice(len(many), MODULES, replace=False))]
    mutants = []
    for path in chosen:
        for index in sorted(random.choice(counts[path], PLACES, replace=False)):
            tree = ast.parse(sources[path])
            place = list(_places(tree))[index]
            changed = turned(place)
            assert changed is not None
            mutants.append(
                Mutant(
                    str(path.relative_to(REPOSITORY)), place.lineno, place.end_lineno or 0,
                    ast.unparse(place), ast.unparse(changed),
                    ast.unparse(ast.fix_missing_locations(_At(place).visit(tree))),
                )
            )  # fmt: skip
    return mutants


def copied(folder: Path) -> Path:
    """Copy what git tracks, and what it does not ignore, into a folder."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=REPOSITORY, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    for name in filter(None, listed.split("\0")):
        if (REPOSITORY / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(REPOSITORY / name, folder / name)
    return folder


def environment(folder: Path) -> dict[str, str]:
    """Return the environment of tests in a copy: its package, and the measured data beside us."""
    data = os.environ.get("DVRK_GRAVITY_DATA", str(REPOSITORY.parent / "shared" / "data"))
    return os.environ | {
        "PYTHONPATH": str(folder), "DVRK_GRAVITY_DATA": data, "OPENBLAS_NUM_THREADS": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
    }  # fmt: skip


def measure(folder: Path, jobs: int) -> None:
    """Run all computing tests once, with coverage, and keep what was measured in a folder."""
    with tempfile.TemporaryDirectory() as name:
        copy = copied(Path(name))
        command = [
            sys.executable, "-m", "pytest", "-q", "-n", str(jobs), "--dist", "loadfile",
            "--cov=dvrk_gravity", "--cov-context=test", "--cov-report=", f"--junitxml={TIMES}",
        ]  # fmt: skip
        ended = subprocess.run(command, cwd=copy, env=environment(copy), check=False)
        if ended.returncode:
            sys.exit("mutants: the tests fail without a mutant")
        folder.mkdir(parents=True, exist_ok=True)
        for kept in (LINES, TIMES):
            shutil.copyfile(copy / kept, folder / kept)


class Reach:
    """Which computing tests reach which lines, and how long each takes."""

    def __init__(self, folder: Path) -> None:
        """Read what was measured."""
        self._times = dict(_times(folder / TIMES))
        self._tests = _lines(folder / LINES)

    def tests(self, mutant: Mutant) -> list[str]:
        """Return the tests that reach a mutant, quickest first, then others of their files.

        What tests of a file share (a fixture, a result that is kept) counts as reached by the
        first of them only. No test reaches a default of an argument, which is evaluated as the
        module is imported: all that reach the module are asked.
        """
        lines = self._tests.get(mutant.module, {})
        found = set[str]().union(
            *(lines.get(line, ()) for line in range(mutant.first, mutant.last + 1))
        ) or set[str]().union(*lines.values())
        files = {test.partition("::")[0] for test in found}
        others = {test for test in self._times if test.partition("::")[0] in files} - found
        return [
            test
            for some in (found, others)
            for test in sorted(some, key=lambda test: (self._times.get(test, 0.0), test))
        ]


def _times(path: Path) -> Iterator[tuple[str, float]]:
    """Yield each test and its duration, s, from JUnit's XML."""
    for case in ElementTree.parse(path).iter("testcase"):
        file = case.attrib["classname"].replace(".", "/") + ".py"
        yield f"{file}::{case.attrib['name']}", float(case.attrib["time"])


def _lines(path: Path) -> dict[str, dict[int, set[str]]]:
    """Return the tests by module and line, from coverage.py's database."""
    reached: dict[str, dict[int, set[str]]] = {}
    with sqlite3.connect(path) as database:
        rows = database.execute(
            "select file.path, context.context, line_bits.numbits from line_bits"
            " join file on file.id = line_bits.file_id"
            " join context on context.id = line_bits.context_id"
        )
        for measured, context, bits in rows:
            module = measured[measured.rindex("/dvrk_gravity/") + 1 :]
            test = context.rpartition("|")[0]  # an id may hold one, too
            if test:
                lines = reached.setdefault(module, {})
                # A bit a line; the lowest bit of the first byte is that of line 0.
                ones = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")
                for line in np.flatnonzero(ones).tolist():
                    lines.setdefault(line, set()).add(test)
    return reached


def ask(tests: Sequence[str], folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run some tests of a copy, and stop at the first that fails."""
    (folder / "tests.txt").write_text("\n".join(tests))
    command = [
        "prlimit", f"--cpu={LONGEST}",
        sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", *options, "@tests.txt",
    ]  # fmt: skip
    return subprocess.run(
        command, cwd=folder, env=environment(folder), capture_output=True, text=True,
        timeout=PATIENCE, check=False,
    )  # fmt: skip


def judge(mutant: Mutant, tests: Sequence[str], folder: Path) -> Verdict:
    """Put a mutant into a copy, ask the tests that reach it, and take it out again.

    A test that fails is asked once more, alone: on a busy machine some fail by themselves.
    """
    path = folder / mutant.module
    original = path.read_text(encoding="utf-8")
    path.write_text(mutant.source, encoding="utf-8")
    noticed, left = "", list(tests)
    try:
        while left and not noticed:
            ended = ask(left, folder)
            if not ended.returncode:
                break
            said = ended.stdout.splitlines()
            failed = [
                test for test in left
                if any(line.startswith((f"FAILED {test}", f"ERROR {test}")) for line in said)
            ]  # fmt: skip
            first = max(failed, key=len, default="")  # of names that others begin with
            if ended.returncode < 0:
                noticed = f"no end within {LONGEST} s of a processor"
            elif not first:
                noticed = "an error while collecting"
            elif ask([first], folder).returncode:
                noticed = first
            else:
                left = left[left.index(first) + 1 :]
    except subprocess.TimeoutExpired:
        noticed = f"no end within {PATIENCE:g} s"
    finally:
        path.write_text(original, encoding="utf-8")
    place = f"{mutant.module}:{mutant.first}"
    return Verdict(place, mutant.before, mutant.after, len(tests), noticed)


def judge_all(mutants: Sequence[Mutant], reach: Reach, jobs: int) -> list[Verdict]:
    """Judge each mutant, as many at once as there are copies."""
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(jobs) as pool:
        copies: SimpleQueue[Path] = SimpleQueue()
        for k in range(jobs):
            copies.put(copied(Path(name) / str(k)))
        asked = {test for mutant in mutants for test in reach.tests(mutant)}
        if ask(sorted(asked), Path(name) / "0", "--collect-only").returncode:
            sys.exit("mutants: --coverage is of other tests: give a new folder")

        def one(mutant: Mutant) -> Verdict:
            folder = copies.get()
            try:
                verdict = judge(mutant, reach.tests(mutant), folder)
            finally:
                copies.put(folder)
            print(_row(verdict), flush=True)
            return verdict

        return list(pool.map(one, mutants))


def _row(verdict: Verdict) -> str:
    return (
        f"{'noticed' if verdict.noticed_by else 'LIVED  '} {verdict.place}: "
        f"{verdict.before} -> {verdict.after} [{verdict.tests} tests] {verdict.noticed_by}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge the mutants of a seed; return 1 if fewer are noticed than wanted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--coverage", type=Path,
        help="keep in this folder which tests reach which lines, or read it from there, as long"
        " as the package does not change and no test goes (those that come are not asked)",
    )  # fmt: skip
    parser.add_argument("--list", action="store_true", help="the places only")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(arguments)
    mutants = draw(args.seed)
    if args.list:
        for mutant in mutants:
            print(f"{mutant.module}:{mutant.first}: {mutant.before} -> {mutant.after}")
        return 0
    with tempfile.TemporaryDirectory() as name:
        folder = args.coverage or Path(name)
        if not (folder / TIMES).is_file():
            measure(folder, args.jobs)
        reach = Reach(folder)
    verdicts = judge_all(mutants, reach, args.jobs)
    noticed = sum(bool(verdict.noticed_by) for verdict in verdicts)
    lived = [verdict for verdict in verdicts if not verdict.noticed_by]
    print(f"\n{noticed} of {len(verdicts)} noticed (wanted: {WANTED:.0%}); lived:")
    print("\n".join(_row(verdict) for verdict in lived) or "none")
    if args.json is not None:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        report: Mapping[str, object] = {
            "seed": args.seed, "noticed": noticed, "verdicts": [asdict(each) for each in verdicts],
        }  # fmt: skip
        args.json.write_text(json.dumps(report, indent=1))
    return int(noticed < WANTED * len(verdicts))


if __name__ == "__main__":
    sys.exit(main())
