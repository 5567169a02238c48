"""CSV files are read as the programs of the field write them, or refused with the way out."""

import numpy as np
import pytest
from recording_samples import ARM, wave
from support import MODEL_FILE

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.command_line import run
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording import Recording, check

CLEAN = wave(150)
EPOCH = 1_700_000_000
N = range(7)
FIELDS = ("position", "velocity", "effort")


def text(value):
    return value if isinstance(value, str) else repr(float(value))


def written(path, names, columns, delimiter=",", head="", comma=False):
    """Write a file with a header of some names and rows of some columns."""
    lines = [delimiter.join(names)] if names else []
    for row in zip(*columns, strict=True):
        line = delimiter.join(map(text, row))
        lines.append(line.replace(".", ",") if comma else line)
    path.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def values(*quantities, factors=(1.0, 1.0, 1.0)):
    """Return the columns of some quantities, joint by joint."""
    return [
        factor * getattr(CLEAN, quantity)[:, k]
        for quantity, factor in zip(quantities, factors, strict=False)
        for k in N
    ]


def named(pattern, words=FIELDS):
    """Return names of columns by a pattern of joint, number and word."""
    return [pattern.format(joint=JOINT_NAMES[k], k=k, k1=k + 1, word=word)
            for word in words for k in N]  # fmt: skip


ALL = values(*FIELDS)
DEGREES = values(*FIELDS, factors=(180 / np.pi, 180 / np.pi, 1000.0))
T = CLEAN.time
DATES = [f"2023-11-14T22:13:{20 + t:09.6f}+00:00" for t in T]
LONG = [np.full(150, 2.0), np.arange(150.0)]

# names, columns, and how they are written
FORMS = {
    "PlotJuggler, ROS 2": (
        ["__time", "/MTMR/measured_js/header/stamp/sec", "/MTMR/measured_js/header/stamp/nanosec",
         *named("/MTMR/measured_js/{joint}/{word}"), *named("/MTMR/setpoint_js/{joint}/{word}")],
        [T + EPOCH + 0.01, [str(EPOCH + int(t)) for t in T],
         [str(round((t % 1.0) * 1e9)) for t in T], *ALL, *[-c for c in ALL]], {},
    ),
    "pandas, dates as index": (["", *named("{joint}.{word}")], [DATES, *ALL], {}),
    "q, qd, tau": (["t", *named("{word}{k1}", ("q", "qd", "tau"))], [T, *ALL], {}),
    "rostopic echo -p": (
        ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id",
         *[f"field.name{k}" for k in N], *named("field.{word}{k}")],
        [(T + 9.0) * 1e9 + EPOCH * 1e9, LONG[1], (T + EPOCH) * 1e9, [""] * 150,
         *[[name] * 150 for name in JOINT_NAMES], *ALL], {},
    ),
    "ros2 topic echo --csv": (
        None,
        [[str(EPOCH + int(t)) for t in T], [str(round((t % 1.0) * 1e9)) for t in T], [""] * 150,
         *[[name] * 150 for name in JOINT_NAMES], *ALL], {},
    ),
    "UR's recorder": (
        ["timestamp", *named("actual_{word}_{k}", ("q", "qd", "current")),
         *named("target_{word}_{k}", ("q", "qd", "moment"))],
        [T, *ALL, *[-c for c in ALL]], {"delimiter": " "},
    ),
    "libfranka": (
        ["duration", "success_rate", *named("state.{word}[{k}]", ("q", "q_d", "dq", "tau_J")),
         *named("cmd.{word}[{k}]", ("q", "dq_c"))],
        [T, LONG[0], *values("position"), *[c + 1 for c in values("position")],
         *values("velocity", "effort"), *ALL[:14]], {},
    ),
    "cisst's collector": (
        ["# Ticks", "measured_js-timestamp", *named("measured_js.{word}[{k}]",
                                                    ("Position", "Velocity", "Effort"))],
        [LONG[1], T, *ALL], {"head": "# Component name : MTMR\n# Data format : Text (CSV)\n#\n"},
    ),
    "semicolons and decimal commas": (
        ["time", *named("{joint}.{word}")], [T, *ALL], {"delimiter": ";", "comma": True}),
    "units": (
        ["time [ms]", *[f"{name} {unit}" for name, unit in zip(
            named("{joint}.{word}"), 7 * ["[deg]"] + 7 * ["[deg/s]"] + 7 * ["(mNm)"],
            strict=True)]],
        [1000 * T, *DEGREES], {},
    ),
    "ns since 1970": (["time", *named("{joint}.{word}")], [(T + EPOCH) * 1e9, *ALL], {}),
    "columns of other things": (
        ["time", *named("{joint}.{word}"), "comment"], [T, *ALL, ["fine"] * 150], {}),
}  # fmt: skip


def test_what_the_programs_of_the_field_write_is_read(tmp_path):
    for form, (names, columns, how) in FORMS.items():
        found = Recording.load(written(tmp_path / "a.csv", names, columns, **how), arm=ARM)
        assert found.joints == JOINT_NAMES, form
        np.testing.assert_allclose(found.time, CLEAN.time, atol=1e-6, err_msg=form)
        for name in FIELDS:
            read, sent = getattr(found, name), getattr(CLEAN, name)
            np.testing.assert_allclose(read, sent, rtol=1e-12, atol=1e-15, err_msg=form)


def test_what_was_taken_for_what_is_named(tmp_path):
    names, columns, how = FORMS["UR's recorder"]
    found = Recording.load(written(tmp_path / "a.csv", names, columns, **how), arm=ARM)
    (note,) = [str(warning) for warning in check(found) if warning.kind == "columns"]
    assert "actual_q_0 as outer_yaw.position" in note
    assert "target_q_0" in note.rpartition("not read")[2]


MINE = ["Zeit", *[f"A{k}" for k in N], *[f"M{k}" for k in N]]
MINE_COLUMNS = [1000 * T, *values("position", factors=[180 / np.pi]), *values("effort")]
MAP = {"Zeit": "time[ms]"} | {f"A{k}": f"{JOINT_NAMES[k]}.position[deg]" for k in N} | {
    f"M{k}": f"{JOINT_NAMES[k]}.effort" for k in N
}  # fmt: skip


def test_other_names_are_mapped_by_columns(tmp_path):
    by_number = {str(k + 1): target for k, target in enumerate(MAP.values())}
    (tmp_path / "map.yaml").write_text("\n".join(f"{n}: {t}" for n, t in MAP.items()))
    for names, given in (
        (MINE, MAP),
        (MINE, ",".join(f"{name}={target}" for name, target in MAP.items())),
        (MINE, tmp_path / "map.yaml"),
        (None, ",".join(f"{name}={target}" for name, target in by_number.items())),
    ):
        path = written(tmp_path / "a.csv", names, MINE_COLUMNS)
        found = Recording.load(path, arm=ARM, columns=given)
        np.testing.assert_allclose(found.position, CLEAN.position, rtol=1e-12)
        np.testing.assert_allclose(found.time, CLEAN.time, atol=1e-9)
        assert found.velocity is None


def test_every_verb_takes_columns(tmp_path, capsys):
    path = str(written(tmp_path / "a.csv", MINE, MINE_COLUMNS))
    given = ["--columns", ",".join(f"{name}={target}" for name, target in MAP.items())]
    assert run("dvrk_gravity.cli.convert", [path, str(tmp_path / "bag"), *given]) == 0
    assert Recording.load(tmp_path / "bag").joints == JOINT_NAMES
    model, out = ["--model", str(MODEL_FILE)], ["--out", str(tmp_path / "x.yaml")]
    for verb, words in (
        ("identify", ["--arm", "mtmr", *out]), ("diagnose", model + out), ("evaluate", model)
    ):  # fmt: skip
        assert run(f"dvrk_gravity.cli.{verb}", [path, *words]) == 2
        assert "--columns" in capsys.readouterr().err


def row(*cells):
    return ",".join(cells) + "\n"


# The file, and tokens of the refusal.
REFUSED = {
    "no header": ("0,1,2\n1,2,3\n", ["line 1", "--columns"]),
    "another number of joints": (row("t", "q1", "q2") + "0,1,2\n", ["'q1'", "expected 7 of arm"]),
    "a time of another name": (
        row("Zeit", "outer_yaw.position") + "0,1\n", ["Zeit: --columns NAME=time"],
    ),
    "two efforts": (
        row("t", *named("{word}_{k}", ("q", "actual_current", "actual_moment"))) + 22 * "0," + "\n",
        ["'actual_current_0'", "'actual_moment_0'"],
    ),
    "a column twice, not the same": (
        row("time", "time", "outer_yaw.position") + "0,0,1\n1,2,1\n", ["line 3: column 'time'"],
    ),
    "an unknown unit": (
        row("time", "outer_yaw.position [counts]") + "0,1\n", ["counts", "one of rad, "],
    ),
}  # fmt: skip


def test_what_would_have_to_be_guessed_is_refused_with_the_option_that_says_it(tmp_path):
    for case, (content, tokens) in REFUSED.items():
        (tmp_path / "a.csv").write_text(content)
        with pytest.raises(RecordingError) as caught:
            Recording.load(tmp_path / "a.csv", arm=ARM)
        assert all(token in str(caught.value) for token in tokens), (case, caught.value)
        assert "\n" not in str(caught.value), case


def test_a_few_rows_that_are_none_are_left_out_and_the_first_is_named(tmp_path):
    rows = [f"{k},1,{k}" for k in range(9000)]
    for bad in ("5,1,x", "5,1", "5,1,2,3", "--- restarted ---", "5;1;2"):
        rows[5000] = rows[7000] = bad
        text = "time,outer_yaw.position,outer_yaw.effort\n" + "\n".join(rows)
        (tmp_path / "a.csv").write_text(text)
        found = Recording.load(tmp_path / "a.csv")
        (note,) = found.notes
        assert (len(found), note.kind, note.left_out) == (8998, "unreadable", 2), bad
        assert "line 5002: " in note.text, bad
