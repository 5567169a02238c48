"""The DH tables in the shipped arms' files, for what is built from them another way."""

from __future__ import annotations

import math

from dvrk_gravity.arms.dh import DHRow
from dvrk_gravity.files import yaml_file
from dvrk_gravity.files.resources import config_path


def dh_table(name: str) -> list[DHRow]:
    """Rows of an arm's file, in rad and m."""
    return [
        DHRow(math.radians(row["alpha"]), row["a"], row["d"], math.radians(row["offset"]))
        for row in yaml_file.load(config_path(f"arms/{name}.yaml"))["joints"]
    ]
