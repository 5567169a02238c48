"""The commands of the tutorials work as they are printed, with shorter motions."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from support import REPOSITORY

from testing.world import COARSE

PAGES = REPOSITORY / "docs" / "tutorials"
SPEC = importlib.util.spec_from_file_location("play", PAGES / "play.py")
play = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(play)

ENVIRONMENT = os.environ | {"PYTHONPATH": str(REPOSITORY)}
DURATION = 16.0  # s
BRIEF = "--simulated --duration 12"

pytestmark = pytest.mark.usefixtures("four_folds", "brief_simulation", "blank_pictures")


@pytest.fixture
def known(monkeypatch):
    """Leave the registered effects as they were."""
    from dvrk_gravity.effects.base import registry

    monkeypatch.setattr(registry, "_effects", dict(registry._effects))


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Record for a shorter time, in longer steps of the simulation."""
    spec = importlib.util.spec_from_file_location("record", PAGES / "record.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "SimulatedArm", partial(module.SimulatedArm, dt=COARSE))
    whole = module.record
    module.record = lambda plant, seed: whole(plant, seed, DURATION)
    monkeypatch.setitem(sys.modules, "record", module)


def printed(capsys, page, folder, shorter=None) -> str:
    play.play(PAGES / f"{page}.md", folder, shorter)
    return capsys.readouterr().out


def test_the_first_hour_finds_the_load_and_its_report_is_read(tmp_path, capsys):
    shown = printed(capsys, "first_hour", tmp_path)
    assert "1  payload" in shown
    assert (tmp_path / "why" / "extended_model.yaml").is_file()
    read = printed(capsys, "read_a_report", tmp_path).splitlines()
    assert read[1].startswith("payload")
    assert read[-7].startswith("outer_yaw")


def test_a_known_truth_is_recovered(tmp_path, capsys):
    shown = printed(capsys, "recover_a_known_truth", tmp_path).splitlines()
    held, _, count = next(line for line in shown if " of " in line).split()
    assert 2 * int(held) > int(count) > 0
    assert shown[-1].startswith("wrist_platform has ")
    assert "stiffness" in shown[-1]


def test_a_tool_is_found_and_its_mass_is_reported(tmp_path, capsys):
    longest = f"{play.VERB}diagnose loaded.csv --model psm.yaml --out unknown_place"
    shown = printed(capsys, "weigh_a_tool", tmp_path, {longest: ""})
    assert "payload  pitch" in shown


def test_an_arm_of_a_urdf_is_identified_and_its_wrong_mass_is_found(tmp_path, capsys):
    shown = printed(capsys, "my_urdf", tmp_path)
    assert "payload" in shown
    assert (tmp_path / "identified.urdf").is_file()


def test_an_effect_of_one_file_is_named_in_its_words(known, tmp_path, capsys):
    assert "wrist_platform stirs a fluid" in printed(capsys, "add_an_effect", tmp_path)


def test_an_mtm_is_moved_identified_and_written_for_its_console(tmp_path, capsys):
    shown = printed(capsys, "calibrate_my_mtm", tmp_path, {"--simulated": BRIEF})
    assert (tmp_path / "gc-MTMR-12345.json").is_file()
    assert "verdict in the model file" in shown


def test_every_tutorial_is_played_here():
    tests = Path(__file__).parent.glob("test_tutorial*.py")
    text = "".join(path.read_text(encoding="utf-8") for path in tests)
    assert [page.stem for page in PAGES.glob("*.md") if f'"{page.stem}' not in text] == []


def test_a_command_that_fails_and_a_text_that_is_not_there_are_refused(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```sh\npython -m dvrk_gravity evaluate none.csv --model none.yaml\n```\n")
    with pytest.raises(ValueError, match="exit status 2"):
        play.play(page, tmp_path / "out")
    with pytest.raises(ValueError, match=r"page\.md has no 'something'"):
        play.play(page, tmp_path / "out", {"something": "else"})
    page.write_text("```sh\nrm -r everything\n```\n")
    with pytest.raises(ValueError, match="'rm -r everything': expected python -m dvrk_gravity"):
        play.play(page, tmp_path / "out")


def test_blocks_for_a_real_arm_are_not_run_and_named_files_are_written(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "```console\n$ rm -r everything\n```\n\n```yaml\n# limits.yaml\na: 1\n```\n\n"
        "```text\nprinted\n```\n\n```python\nimport os\nassert os.path.exists('limits.yaml')\n```\n"
    )
    play.play(page, tmp_path / "out")
    assert (tmp_path / "out" / "limits.yaml").read_text() == "# limits.yaml\na: 1\n"


@pytest.mark.slow
@pytest.mark.parametrize("page", [p.stem for p in PAGES.glob("*.md") if "```text" in p.read_text()])
def test_a_page_has_the_figures_that_its_commands_print(page, tmp_path):
    words = [sys.executable, PAGES / "play.py", page, "--out", tmp_path]
    played = subprocess.run(words, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True)
    assert played.returncode == 0, played.stderr


PAGE = """```text
joint     RMSE
elbow     0.0122  good: held-out error 22 %
…
```
"""


@pytest.mark.parametrize(
    ("printed", "stale"),
    [
        ("joint RMSE\nelbow 0.0122 good: held-out error 22 %\nmore", 0),
        ("joint RMSE\nelbow 0.0130 good: held-out error 24 %", 0),  # another computer
        ("joint RMSE\nelbow 0.0150 good: held-out error 22 %", 1),
        ("joint RMSE\nelbow 0.0122 usable: held-out error 22 %", 1),
        ("elbow 0.0122 good: held-out error 22 %", 1),
        ("", 2),
    ],
)
def test_a_figure_on_a_page_is_one_that_its_commands_print(printed, stale):
    assert len(play.not_printed(PAGE, printed)) == stale
