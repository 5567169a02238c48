"""What docs/stability.md promises is what there is, and nothing public is missing from it."""

from __future__ import annotations

import importlib.util
import re

from made_results import TIME, example_diagnosis, fit_of
from support import REPOSITORY
from made_results import RESULTS

import dvrk_gravity

PAGE = REPOSITORY / "docs" / "stability.md"


def test_the_page_lists_what_is_public():
    path = REPOSITORY / "docs" / "stability_tables.py"
    spec = importlib.util.spec_from_file_location("stability_tables", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = PAGE.read_text(encoding="utf-8")
    assert module.written() == text, "docs/stability_tables.py --write renews it; so a user notices"
    for name in dvrk_gravity.__all__:
        assert re.search(rf"`dvrk_gravity\.{name}[.`]", text), name


def keys_of(file: str) -> list[str]:
    """Return the keys that the page's row on a file lists, those of its parts after a `;`."""
    row = next(line for line in PAGE.read_text().splitlines() if line.startswith(f"| `{file}`"))
    return re.findall(r"`(\w+)`", row.split("|")[2])


def test_the_page_lists_the_keys_of_json_files():
    diagnosis = example_diagnosis().to_dict()
    assert keys_of("findings.json") == [*diagnosis, *diagnosis["findings"][0]]
    assert keys_of("identify --json") == list(fit_of(TIME).to_json())
    evaluation = RESULTS["evaluate"][0]()
    assert keys_of("evaluate --json") == list(evaluation.to_json())
