"""A fleet's bookkeeping and its statistics: keys, manifests, dates, change points, discoveries."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from support import REPOSITORY

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.fleet import (
    COLUMNS,
    ArmEntry,
    ArmHistory,
    FleetPlan,
    Manifest,
    Result,
    Series,
    Store,
    Unit,
    Visit,
    assess_changes,
    date_in,
    date_of,
    fit,
    histories,
    key_of,
    parquet,
    scan,
    table,
    with_fit,
    work,
)
from dvrk_gravity.recording import Recording

RANDOM = 0


def a_series(random: np.random.Generator, values: int, joint: str = "pitch") -> Series:
    """Return a series that only varies: more than its errors say, and over two years."""
    day = np.sort(random.uniform(0.0, 730.0, values)) + 20_000.0
    error = random.uniform(0.1, 0.3, values)
    value = random.standard_normal(values) * np.hypot(error, 1.0)
    return Series("joint_offset", joint, "offset", "rad", 0.1, day, value, error)


def test_a_key_is_of_content_model_and_version_and_of_nothing_else():
    keys = [
        key_of("a", "b", "1"),
        key_of("c", "b", "1"),
        key_of("a", "d", "1"),
        key_of("a", "b", "2"),
    ]
    assert len(set(keys)) == 4
    assert key_of("a", "b", "1") == keys[0]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("arms: [{arm: ecm, recordings: [a.csv]}]", r"arms\[0\].serial"),
        ("arms: [{serial: 1, arm: ecm, recordings: []}]", r"arms\[0\].recordings"),
        ("arms: [{serial: 1, arm: ecm, recordings: [a.csv], modle: m.yaml}]", "modle"),
        ("arms: [{serial: ../1, arm: ecm, recordings: [a.csv]}]", "serial.*file's name"),
        ("arms: [{serial: 1, arm: ecm, recordings: [a.csv]}, "
         "{serial: 1, arm: psm, recordings: [b.csv]}]", "serial.*one entry for each arm"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_manifest_is_a_line_that_names_file_and_entry(tmp_path, text, named):
    path = tmp_path / "fleet.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=named) as caught:
        Manifest.load(tmp_path)
    assert "fleet.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_without_manifest_leads_to_the_scan_and_a_pattern_without_files_is_named(tmp_path):
    with pytest.raises(ConfigError, match="fleet --scan"):
        Manifest.load(tmp_path)
    with pytest.raises(ConfigError, match=r"arms\.7\.recordings.*at least one recording"):
        list(ArmEntry("7", "ecm", (str(tmp_path / "nothing/*.csv"),)).files())


def test_a_scan_reads_kinds_from_paths_and_serial_numbers_from_console_files(tmp_path):
    for name in ("MTMR/2025-01-02_run.csv", "MTMR/2025-01-03_run.csv", "psm2/41234/x_20250101.csv"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("time,a.position\n0,1\n")
    (tmp_path / "gc-MTMR-28002.json").write_text("{}")
    manifest = scan(tmp_path)
    assert [(arm.serial, arm.arm) for arm in manifest.arms] == [("28002", "mtmr"), ("41234", "psm")]
    manifest.save(tmp_path / "fleet.yaml")
    again = Manifest.load(tmp_path)
    assert [len(list(arm.files())) for arm in again.arms] == [2, 1]


def test_a_date_is_of_the_clock_in_the_file_else_of_its_name_else_of_the_file(tmp_path):
    assert date_in("a/2024-11-30/rec_2025_03_14-09_26_53/x.csv") == datetime(
        2025, 3, 14, 9, 26, 53, tzinfo=UTC
    )
    assert date_in("serial_20000101234/rec.csv") is None
    path = tmp_path / "2025-03-14.csv"
    path.write_text("time,a.position\n1700000000.5,1\n")
    assert date_of(path) == (datetime.fromtimestamp(1700000000.5, UTC), "time column")
    path.write_text("time,a.position\n0.0,1\n")
    assert date_of(path) == (datetime(2025, 3, 14, tzinfo=UTC), "name")
    other = path.rename(tmp_path / "run.csv")
    assert date_of(other)[1] == "modified"


def test_what_is_there_is_not_done_again_by_name_or_by_content_also_once_results_are_joined(
    tmp_path,
):
    for number in range(3):
        (tmp_path / f"{number}.csv").write_text(f"not a recording {number}")
    (tmp_path / "m.yaml").write_text("a model")
    entry = ArmEntry("1", "ecm", (str(tmp_path / "*.csv"),), str(tmp_path / "m.yaml"))
    store = Store.open(tmp_path / "out")
    units = list(FleetPlan.of(Manifest((entry,)), store).pending_comparisons())
    assert len(units) == 3
    for unit in units[:2]:
        content = Path(unit.recording).name
        key = key_of(content, unit.model_hash)
        row = {"key": key, "kind": "recording", "serial": "1", "recording": unit.recording,
               "size": unit.size, "modified": unit.modified, "model": unit.model_hash,
               "version": "0.1.0", "content": content}  # fmt: skip
        store.write(Result(key, table=parquet([row])))
    for _ in range(2):
        planned = FleetPlan.of(Manifest((entry,)), Store.open(tmp_path / "out"))
        assert [each.recording for each in planned.pending_comparisons()] == [units[2].recording]
        assert planned.skipped == 2
        assert table(tmp_path / "out").num_rows == 2
        store.compact(2)
    left = next(planned.pending_comparisons())
    assert left.known == {"0.csv", "1.csv"}


def test_a_damaged_recording_is_a_row_and_a_line_and_no_error(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("time,a.position\n0,nothing\n")
    result = work(Unit("ecm", "1", str(path), "2025-01-01T00:00:00+00:00", "name", 1, 1))
    assert result.verdict == "failed"
    assert [str(path) in line for line in result.failures] == [True]
    Store.open(tmp_path / "out").write(result)
    rows = table(tmp_path / "out", columns=("kind", "verdict", "text")).to_pylist()
    assert [row["kind"] for row in rows] == ["failure", "recording"]


@pytest.mark.parametrize("shape", ["break", "slope"])
def test_a_change_of_a_known_date_lies_in_its_interval_nine_times_in_ten(shape):
    random, held, named, count = np.random.default_rng(RANDOM), 0, 0, 60
    for _ in range(count):
        series, at = a_series(random, 20), random.uniform(220.0, 480.0) + 20_000.0
        after = series.day - at
        course = 5.0 * (after > 0.0) if shape == "break" else np.maximum(after, 0.0) / 40.0
        fitted = fit(series.day, series.value + course, series.error)
        assert fitted.change is not None
        low, high = fitted.change.since
        held += low <= at <= high
        named += fitted.change.shape == shape
    assert held >= 0.9 * count
    assert named >= 0.9 * count


def test_p_values_of_series_that_do_not_change_are_no_smaller_than_they_say():
    random = np.random.default_rng(RANDOM)
    p_values = []
    for values in (6, 9, 14, 24):
        p_values += [fit(s.day, s.value, s.error).p_value
                     for s in (a_series(random, values) for _ in range(60))]  # fmt: skip
    for level in (0.2, 0.05, 0.01):
        assert np.mean(np.array(p_values) < level) <= level


def an_arm(serial: int, series: list[Series]) -> ArmHistory:
    fitted = tuple(map(with_fit, series))
    p_value = min(1.0, len(series) * min(each.fitted.p_value for each in fitted))
    visits = tuple(Visit(day, "explained", "r", "", "") for day in series[0].day.tolist())
    return ArmHistory(str(serial), "ecm", visits, fitted, p_value)


def test_of_arms_that_do_not_change_hardly_one_is_reported_and_those_that_do_are():
    random, joints = np.random.default_rng(RANDOM), ("a", "b", "c", "d", "e")
    clean = [an_arm(k, [a_series(random, 15, joint) for joint in joints]) for k in range(40)]
    assert not [arm for arm in assess_changes(clean) if arm.changes]
    changed = []
    for number in range(100, 108):
        series = [a_series(random, 15, joint) for joint in joints]
        course = 8.0 * (series[1].day > 20_400.0)
        # One change seen in two quantities, the second of which shows it less clearly.
        for index, part in ((1, 1.0), (3, 0.8)):
            series[index] = replace(
                series[index], day=series[1].day, value=series[index].value + part * course
            )
        changed.append(an_arm(number, series))
    found = assess_changes([*clean, *changed])
    reported = [arm for arm in found if arm.changes]
    assert [arm in found[: len(reported)] for arm in reported] == [True] * len(reported)
    false = [arm for arm in reported if int(arm.serial) < 100]
    assert len(reported) - len(false) == 8
    assert len(false) <= 1
    assert sum(len(arm.changes) for arm in reported) <= 9
    assert {arm.changes[0].series.joint for arm in reported if arm not in false} <= {"b", "d"}


def test_results_of_no_arm_and_no_results_are_a_line(tmp_path):
    with pytest.raises(ConfigError, match="folder of `fleet --out`"):
        histories(tmp_path)
    Store.open(tmp_path)
    with pytest.raises(ConfigError, match=r"--arm.*results of arm 7"):
        histories(tmp_path, "7")


def test_a_recording_behind_a_url_is_found_dated_and_read_by_a_copy(tmp_path):
    folder = tmp_path / "far"
    folder.mkdir()
    (folder / "2025-03-14.csv").write_text("time,a.position\n0,nothing\n")
    entry = ArmEntry("1", "ecm", (f"file://{folder}/*.csv",))
    planned = FleetPlan.of(Manifest((entry,)), Store.open(tmp_path / "out"))
    ((_, units),) = planned.references()
    url = f"file://{folder}/2025-03-14.csv"
    assert [(unit.recording, unit.date[:10], unit.date_from) for unit in units] == [
        (url, "2025-03-14", "name")
    ]
    result = work(units[0])
    assert [line.startswith(url) for line in result.failures] == [True]


def test_a_bag_is_dated_by_its_first_message_and_scanned_by_its_namespace(tmp_path):
    time = np.arange(100) * 0.01
    wave = np.sin(time)[:, None] * np.ones(4)
    recording = Recording(
        Arm.load("ecm").joint_names, time, wave, wave, wave, start_ns=1_700_000_000 * 10**9
    )
    (tmp_path / "ECM_44001").mkdir()
    recording.save(tmp_path / "ECM_44001" / "run", topic="/ECM/measured_js")
    when, where = date_of(tmp_path / "ECM_44001" / "run")
    assert (when, where) == (datetime.fromtimestamp(1_700_000_000, UTC), "bag")
    (arm,) = scan(tmp_path).arms
    assert (arm.arm, arm.serial) == ("ecm", "44001")
    assert len(arm.recordings) == 1


def test_the_page_has_the_table_s_columns():
    page = (REPOSITORY / "docs" / "fleet.md").read_text(encoding="utf-8")
    for name, (kind, meaning) in COLUMNS.items():
        assert f"| `{name}` | {kind} | {meaning} |" in page
