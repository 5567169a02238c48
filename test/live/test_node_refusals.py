"""Parameters that a node cannot use end it with one line that names file and parameter."""

from __future__ import annotations

from robots import UR5
from support import MODEL_FILE

from dvrk_gravity.__main__ import main


def test_a_parameter_that_a_node_cannot_use_is_named(domain, tmp_path, capsys):
    text = MODEL_FILE.read_text()
    unknown, limit, nine = (tmp_path / f"{name}.yaml" for name in ("unknown", "limit", "nine"))
    unknown.write_text(text.replace("gravity_enabled:", "gravity_enable:", 1))
    row = "arm: mtmr\n    effort_limit: [1., 1., -1., 1., 1., 1., 1.]"
    limit.write_text(text.replace("arm: mtmr", row, 1))
    nine.write_text("/**:\n  ros__parameters:\n    beta: [1.0, 2., 3., 4., 5., 6., 7., 8., 9.]\n")
    tab = tmp_path / "tab.yaml"
    tab.write_text("/**:\n\tros__parameters:\n")
    for verb, words, tokens in (
        ("compensator", ["--params-file", tab], [f"{tab}", "line 2"]),
        ("compensator", ["--params-file", MODEL_FILE, "-r", "__ns:=/lab/PSM2"], ["/lab/PSM2"]),
        ("simulator", ["-p", "friction_scale:=-1.0"], ["friction_scale: got -1.0"]),
        ("simulator", ["-p", "friction_scal:=1.0"], ["friction_scale?"]),
        ("simulator", ["-p", f"initial_position:={[0.0, 3.0] + [0.0] * 5}"], ["shoulder_pitch"]),
        ("simulator", ["-p", "arm:=mtmr", "-p", f"plant:={UR5}"], ["mtmr"]),
        ("compensator", ["--params-file", unknown], [f"{unknown}", "gravity_enabled?"]),
        ("compensator", ["--params-file", limit], [f"{limit}: effort_limit[2]: got -1.0"]),
        ("compensator", ["--params-file", nine], [f"{nine}: beta: got '9 numbers', expected 10"]),
        ("compensator", [], ["beta", "--params-file"]),
        ("compensator", ["-p", "arm:=mtmx", "-p", f"beta:={[0.1] * 10}"], ["mtmr"]),
        ("watchdog", ["-p", "watchdog_timeout:=-1.0"], ["watchdog_timeout: got -1.0"]),
    ):
        capsys.readouterr()
        assert main([verb, "--ros-args", *map(str, words)]) == 2
        printed = capsys.readouterr().err.strip()
        assert all(token in printed.splitlines()[-1] for token in tokens), printed
