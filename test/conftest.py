"""Fixtures of all tests. Live ones have further ones in live/."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings
from support import REPOSITORY, examples

settings.register_profile(
    "repeatable", derandomize=True, deadline=None, database=None, max_examples=examples(50)
)
settings.load_profile("repeatable")


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> None:
    """Let Ctrl-C be seen even where a shell runs the tests in the background, ignoring it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def measured_data() -> Path:
    """Folder of real measured data; tests that need it are skipped, saying so, without it."""
    folder = Path(os.environ.get("DVRK_GRAVITY_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no measured data in {folder} (DVRK_GRAVITY_DATA names another folder)")
    return folder
