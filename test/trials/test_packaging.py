"""The package as other processes see it: an archive, a workspace, an import without ROS."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from support import REPOSITORY

PACKAGE = REPOSITORY / "dvrk_gravity"


def python(*words: str, path: Path = REPOSITORY, **variables: str) -> subprocess.CompletedProcess:
    environment = {**os.environ, "PYTHONPATH": str(path), **variables}
    return subprocess.run(
        [sys.executable, *words], env=environment, cwd=path.parent, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


def test_what_is_slow_to_load_and_ros_are_loaded_by_what_needs_them():
    program = (
        "import sys; from dvrk_gravity import Recording, TorqueModel, diagnose, identify\n"
        "print({name.split('.')[0] for name in sys.modules} & {'scipy', 'matplotlib', 'rclpy'})"
    )
    process = python("-c", program)
    assert (process.stdout.strip(), process.stderr) == ("set()", "")
