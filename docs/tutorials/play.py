"""Run the commands of tutorials, so that their figures can be printed again.

    PYTHONPATH=. python docs/tutorials/play.py recover_a_known_truth --out out/tutorials

Of a page's fenced blocks it runs those of ``sh``, whose lines are verbs of this package, and those
of ``python``, all in one folder. A block whose first line is a comment with a file's name is
written to that file, and a .py file that the page links is copied. Blocks of ``console`` are for a
real arm, or for another program, and are not run.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
VERB = "python -m dvrk_gravity "
_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_LINKED = re.compile(r"\]\(([\w./]+\.py)\)")
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


def main_of_script() -> None:
    """Play the pages that are named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("pages", nargs="+", metavar="PAGE")
    parser.add_argument("--out", type=Path, required=True, help="folder of the files")
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    os.environ.setdefault("MPLBACKEND", "Agg")
    for page in arguments.pages:
        play(HERE / f"{Path(page).stem}.md", out)


if __name__ == "__main__":
    main_of_script()
