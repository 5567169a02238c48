"""Run the commands of tutorials, and compare what they print with the figures on the page.

    PYTHONPATH=. python docs/tutorials/play.py recover_a_known_truth --out out/tutorials

Of a page's fenced blocks it runs those of ``sh``, whose lines are verbs of this package, and those
of ``python``, all in one folder. A block whose first line is a comment with a file's name is
written to that file, and a .py file that the page links is copied. Blocks of ``console`` are for a
real arm, or for another program, and are not run. Blocks of ``text`` are excerpts of what is
printed; a line of one that is not printed is named at the end, with exit status 1.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, TextIO

HERE = Path(__file__).resolve().parent
VERB = "python -m dvrk_gravity "
_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_LINKED = re.compile(r"\]\(([\w./]+\.py)\)")
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?")
_TENTH = 0.1  # of a figure: another computer rounds otherwise, and a search ends elsewhere. Chosen
_LAST = 2.0  # ... or units of its last digit
_FILE = re.compile(r"(?:#|<!--) (\S+\.\w+)(?: -->)?\n")


class Block(NamedTuple):
    """A fenced block: its language, its text, and the file that it is to be written to."""

    language: str
    text: str
    file: str


def blocks(page: str) -> list[Block]:
    """Return the blocks of a page that are run or written."""
    found = []
    for language, text in _FENCE.findall(page):
        named = _FILE.match(text)
        if named or language in ("sh", "python"):
            found.append(Block(language, text, named[1] if named else ""))
    return found


def commands(text: str) -> Iterator[str]:
    """Yield the commands of a block, those of several lines in one."""
    for line in text.replace("\\\n", " ").splitlines():
        command = line.partition(" # ")[0].strip()
        if command:
            yield command


def play(page: Path, folder: Path, shorter: Mapping[str, str] | None = None) -> None:
    """Run a page's blocks in a folder.

    Args:
        page: The page.
        folder: Where its files are written.
        shorter: Texts of the page and what stands in their place, to save time.

    Raises:
        ValueError: A command that is no verb, that failed (exit status 2), or a text that the page
            lacks.
    """
    text = page.read_text(encoding="utf-8")
    for before, after in (shorter or {}).items():
        if before not in text:
            raise ValueError(f"{page.name} has no {before!r}")
        text = text.replace(before, after)
    folder.mkdir(parents=True, exist_ok=True)
    for linked in _LINKED.findall(text):
        shutil.copy(page.parent / linked, folder)
    names: dict[str, object] = {"__name__": page.stem}
    with contextlib.chdir(folder), _importable(folder):
        for block in blocks(text):
            if block.file:
                Path(block.file).write_text(block.text, encoding="utf-8")
            elif block.language == "python":
                exec(compile(block.text, str(page), "exec"), names)
            else:
                for command in commands(block.text):
                    _run(command)


def not_printed(page: str, printed: str) -> list[str]:
    """Return the lines of a page's blocks of ``text`` that were not printed.

    The words of a line are the same, and figures differ by a tenth, or two units of the last digit.

    Args:
        page: The page's text.
        printed: What its commands printed.
    """
    found = [_parted(line) for line in printed.splitlines()]
    lines = [
        line
        for language, text in _FENCE.findall(page)
        if language == "text"
        for line in text.splitlines()
        if line.strip() != "…"
    ]
    return [line for line in lines if not any(_near(_parted(line), each) for each in found)]


def _parted(line: str) -> tuple[list[str], list[str]]:
    """Return a line's words and its numbers."""
    return _NUMBER.sub("#", line).split(), _NUMBER.findall(line)


def _near(shown: tuple[list[str], list[str]], printed: tuple[list[str], list[str]]) -> bool:
    return shown[0] == printed[0] and all(
        abs(float(a) - float(b))
        <= max(_TENTH * abs(float(a)), _LAST * 10.0 ** -len(a.partition(".")[2]))
        for a, b in zip(shown[1], printed[1], strict=True)
    )


class _Twice(io.StringIO):
    """What keeps all that is printed, and prints it."""

    def __init__(self, shown: TextIO) -> None:
        super().__init__()
        self._shown = shown

    def write(self, text: str) -> int:
        self._shown.write(text)
        return super().write(text)

    def flush(self) -> None:
        self._shown.flush()


@contextlib.contextmanager
def _importable(folder: Path) -> Iterator[None]:
    """Let modules be imported from a folder, and forget them at the end."""
    before = set(sys.modules)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in set(sys.modules) - before:
            if (folder / f"{name}.py").exists():
                del sys.modules[name]


def _run(command: str) -> None:
    """Run a verb."""
    from dvrk_gravity.__main__ import main

    if not command.startswith(VERB):
        raise ValueError(f"{command!r}: expected {VERB}…")
    print(f"$ {command}", flush=True)
    status = main(shlex.split(command.removeprefix(VERB)))
    if status not in (0, 1):  # 1: done, and the answer is no
        raise ValueError(f"{command}: exit status {status}")


def main_of_script() -> int:
    """Play the pages that are named; return 1 if a figure on one is not printed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("pages", nargs="+", metavar="PAGE")
    parser.add_argument("--out", type=Path, required=True, help="folder of the files")
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    os.environ.setdefault("MPLBACKEND", "Agg")
    stale = []
    for name in arguments.pages:
        page = HERE / f"{Path(name).stem}.md"
        with contextlib.redirect_stdout(_Twice(sys.stdout)) as printed:
            play(page, out)
        stale += not_printed(page.read_text(encoding="utf-8"), printed.getvalue())
    for line in stale:
        print(f"on the page, but not printed: {line}", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main_of_script())
