"""The examples run as they stand, and the notebooks are what their scripts are."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import jupytext
import matplotlib
from support import REPOSITORY

from dvrk_gravity import TorqueModel

EXAMPLES = REPOSITORY / "examples"
NOTEBOOKS = [path.with_suffix(".py") for path in sorted(EXAMPLES.glob("*.ipynb"))]


def test_the_examples_run_as_they_stand(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(EXAMPLES)

    runpy.run_path(str(EXAMPLES / "ten_lines.py"))
    assert Path("model.yaml").is_file()
    assert "elbow_pitch has" in capsys.readouterr().out

    monkeypatch.setattr(sys, "argv", ["any_arm.py"])
    runpy.run_path(str(EXAMPLES / "any_arm.py"), run_name="__main__")
    assert TorqueModel.load("model.yaml").arm.joint_names == ("turn", "shoulder", "elbow")
    assert "good" in capsys.readouterr().out

    with matplotlib.rc_context({"backend": "agg"}):
        errors = runpy.run_path(str(EXAMPLES / "identify_and_compare.py"))["errors"]
    assert list(errors.columns) == ["rigid", "full"]
    assert errors["full"].mean() < 0.7 * errors["rigid"].mean()

    names = runpy.run_path(str(EXAMPLES / "what_changed.py"))
    found = names["first"].parameters["coefficient"]
    assert found.low < 0.08 < found.high  # N·m·s/rad, which the script has added
    before, after = (names[name].loc["elbow_pitch", "rmse"] for name in ("before", "after"))
    assert after < 0.7 * before


def test_the_readme_shows_these_ten_lines():
    code = (EXAMPLES / "ten_lines.py").read_text().split('"""')[2].strip()
    assert len([line for line in code.splitlines() if line]) <= 10
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert "\n".join(f"    {line}".rstrip() for line in code.splitlines()) in readme


def test_a_notebook_is_its_script_without_outputs():
    assert len(NOTEBOOKS) == 2
    for script in NOTEBOOKS:
        notebook = jupytext.read(script.with_suffix(".ipynb"))
        cells = [(cell.cell_type, cell.source) for cell in notebook.cells]
        paired = [(cell.cell_type, cell.source) for cell in jupytext.read(script).cells]
        assert cells == paired, f"jupytext --to ipynb {script} renews it"
        assert not any(cell.get("outputs") for cell in notebook.cells)
