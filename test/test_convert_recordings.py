"""The verb ``convert`` between CSV and rosbag2."""

import pytest
from recording_samples import same, shared_data, wave, write_messages

from dvrk_gravity.command_line import run
from dvrk_gravity.recording import BagReader, Recording

CONVERT = "dvrk_gravity.cli.convert"


def convert(*arguments):
    return run(CONVERT, [str(argument) for argument in arguments])


def test_csv_to_bag_and_back_by_command(tmp_path, capsys):
    wave(300).save(tmp_path / "a.csv")
    assert convert(tmp_path / "a.csv", tmp_path / "bag", "--topic", "/MTMR/measured_js") == 0
    assert convert(tmp_path / "bag", tmp_path / "mcap", "--storage", "mcap") == 0
    assert convert(tmp_path / "mcap", tmp_path / "b.csv") == 0
    assert f"{tmp_path / 'bag'}: 300 samples of outer_yaw, " in capsys.readouterr().out
    with BagReader(tmp_path / "bag") as bag:
        assert bag.topics == {"/MTMR/measured_js": "sensor_msgs/msg/JointState"}
    assert (tmp_path / "mcap/mcap.mcap").exists()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_samples_left_out_are_told(tmp_path, capsys):
    (tmp_path / "a.csv").write_text("time,outer_yaw.position\n0,1\n0,1\n1,2\n")
    assert convert(tmp_path / "a.csv", tmp_path / "bag") == 0
    assert "2 samples of outer_yaw, 1 left out" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["bags/mtm_dynamic_sqlite3", "bags/mtm_dynamic_mcap"])
def test_measured_bags_survive_the_way_through_csv(tmp_path, name):
    original = shared_data(name)
    assert convert(original, tmp_path / "a.csv") == 0
    assert convert(tmp_path / "a.csv", tmp_path / "bag", "--storage", "mcap") == 0
    same(Recording.load(original), Recording.load(tmp_path / "bag"))


def bad_inputs(folder):
    wave(300).save(folder / "good.csv")
    wave(9, time=None).save(folder / "static.csv")
    yield folder / "absent.csv", "out.csv", "no such file"
    yield folder / "absent", "out.csv", "expected a recording"
    (folder / "late.csv").write_text(
        "time,outer_yaw.position\n" + "".join(f"{k},1\n" for k in range(30_000)) + 9000 * "1,x\n"
    )
    yield folder / "late.csv", "out", "line 30002: outer_yaw.position is 'x'"
    yield folder / "late.csv", "out.csv", "line 30002: outer_yaw.position is 'x'"
    yield folder / "static.csv", "out", "do not fit in a bag"
    yield folder / "good.csv", "static.csv", "exists already"
    yield folder / "good.csv", "out.json", "expected a .csv file or the name of a new rosbag2"
    write_messages(folder / "bools", [(10**9, b"\0\1\0\0\1")], "mcap", "/b", "std_msgs/msg/Bool")
    yield folder / "bools", "out", "no sensor_msgs/msg/JointState topic"
    wave(3000).save(folder / "cut")
    file = folder / "cut/cut.db3"
    file.write_bytes(file.read_bytes()[:9000])
    yield folder / "cut", "out", "cut off or damaged"


def test_bad_input_is_one_line_and_status_2_and_leaves_nothing(tmp_path, capsys):
    for source, target, expected in bad_inputs(tmp_path):
        before = sorted(tmp_path.iterdir())
        assert convert(source, tmp_path / target) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.startswith("dvrk_gravity convert: ")
        assert expected in captured.err
        assert captured.err.count("\n") == 1
        assert sorted(tmp_path.iterdir()) == before
