"""A recorded drive is judged again as before; what differs is named. drive.mcap is the gate."""

from __future__ import annotations

import contextlib
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.judging import Settings
from companion.cli import main
from companion.config import format_config, load_config
from companion.desk.drives.drive import DriveError
from companion.desk.drives.frames import open_drive
from companion.desk.drives.judge import FIGURES, JudgementRow
from companion.desk.drives.recorded import RecordedDrive, settings_of
from companion.desk.drives.replay import OF_REFERENCES, ReplayComparison, compared, read_rows, write_rows
from companion.desk.drives.replaying import config_of
from companion.observers.recording.foxglove import encode, jpeg_of
from companion.observers.recording.reading import Copy, messages
from tests.companion.desk.drives.record_drive import DRIVE

REFERENCES = Path(f"{DRIVE}.refs.jsonl")
ROW = JudgementRow("frame 1", dict.fromkeys(FIGURES, 0.5), ("blocked",), 0)


def replayed(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any], str]:
    code = main(["replay", *arguments])
    said = capsys.readouterr().out
    return code, json.loads(said.splitlines()[-1]), said


@pytest.mark.slow
def test_the_recorded_drive_is_judged_as_by_the_references(capsys: pytest.CaptureFixture[str]) -> None:
    code, figures, said = replayed(capsys, str(DRIVE))
    assert (code, figures["same"]) == (0, True), said
    assert figures["frames"] == 17
    assert figures["left_out"] == {}


@pytest.mark.slow
def test_it_is_judged_as_the_rover_did_but_for_what_jpeg_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = shutil.copy(DRIVE, tmp_path / "drive.mcap")
    code, figures, said = replayed(capsys, str(copy))
    assert (code, figures["frames"]) == (0, 17), said
    assert "as the rover judged them" in said
    assert 0.0 < figures["worst"]["uncertainty"] < 0.05


@pytest.mark.slow
def test_other_words_are_told_frame_by_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changed = tmp_path / "other.mcap"
    with changed.open("wb") as file:
        copy = Copy(file)
        for one in messages(DRIVE):
            if one.channel.topic == "/words":
                told = json.loads(one.message.data)
                told["words"]["dirt path"] = -1.0
                one.message.data = json.dumps(told).encode()
            copy.add(one)
        copy.finish()
    code, figures, said = replayed(capsys, str(changed), "--refs", str(REFERENCES))
    assert (code, figures["same"]) == (1, False)
    assert "NOT the same" in said
    assert "drivable_share was 1.0000, is 0." in said
    assert figures["reasons"] > 0


@pytest.mark.slow
def test_references_can_be_written_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.jsonl"
    assert main(["replay", str(DRIVE), "--refs", str(mine), "--update-refs"]) == 0
    assert "17 references written" in capsys.readouterr().out
    assert [row.name for row in read_rows(mine)] == [row.name for row in read_rows(REFERENCES)]
    (tmp_path / "broken.jsonl").write_text('{"frame": "frame 6"}\n')
    assert main(["replay", str(DRIVE), "--refs", str(tmp_path / "broken.jsonl")]) == 2
    assert "line 1 is no reference" in capsys.readouterr().err


def test_a_recording_is_a_drive_with_its_own_times() -> None:
    drive = open_drive(str(DRIVE), 10.0)
    frames = list(drive.frames())
    assert drive.count == len(frames) == 17
    assert all(frame.image is not None and frame.image.shape == (240, 320, 3) for frame in frames)
    times = [frame.at for frame in frames]
    assert times == sorted(times)
    assert 35.0 < times[-1] < 60.0


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        ({"lean": [1.5, -0.5], "pose": [3.0, -1.0, 90.0]}, ((1.5, -0.5), (3.0, -1.0, 90.0))),
        ({"lean": [80.0, 0.0], "pose": [1e300, 0.0, 0.0]}, (None, None)),
        ({"lean": "up", "pose": [1.0, None, 0.0]}, (None, None)),
        ({}, (None, None)),
    ],
)
def test_how_the_vehicle_stood_is_read_where_it_was_recorded(
    told: dict[str, Any], expected: tuple[object, object], tmp_path: Path
) -> None:
    changed = tmp_path / "moved.mcap"
    with changed.open("wb") as file:
        copy = Copy(file)
        for one in messages(DRIVE):
            if one.channel.topic == "/assessment":
                one.message.data = json.dumps({**json.loads(one.message.data), **told}).encode()
            copy.add(one)
        copy.finish()
    frames = list(open_drive(str(changed), 10.0).frames())
    assert {(frame.lean, frame.pose) for frame in frames} == {expected}
    assert frames[0].numbered(7).pose == expected[1]


def again_at(copy: Copy, since: int) -> None:
    """Add all messages of the drive, `since` seconds later than they were."""
    for one in messages(DRIVE):
        one.message.log_time += since * 1_000_000_000
        copy.add(one)


@pytest.mark.slow
def test_frames_of_two_starts_of_the_companion_are_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = tmp_path / "both.mcap"
    with both.open("wb") as file:
        copy = Copy(file)
        again_at(copy, 0)
        again_at(copy, 86_400)
        copy.finish()
    folder = tmp_path / "recordings"
    folder.mkdir()
    for name, since in (("000001.mcap", 0), ("000002.mcap", -86_400), ("000003.mcap", 86_400)):
        with (folder / name).open("wb") as file:
            copy = Copy(file)
            again_at(copy, since)
            copy.finish()
    for path, starts in ((both, 2), (folder, 3)):
        frames = list(RecordedDrive(path).recorded())
        names = [one.frame.name for one in frames]
        assert len(set(names)) == len(names) == starts * 17
        assert names[17] == f"{names[0]} (2)"
        assert [one.seen for one in frames[17:34]] == [one.seen for one in frames[:17]]
        times = [one.frame.at for one in frames]
        assert times[0] == pytest.approx(0.1)
        assert times == sorted(set(times)), "they rise, though the clock was set back"
        assert times[17] - times[16] == pytest.approx(1.0)
    assert replayed(capsys, str(both))[:1] == (0,)


def test_a_recorded_configuration_that_cannot_be_used_here_is_named() -> None:
    recording = RecordedDrive(DRIVE)
    recording.config = '[vehicle]\nfile = ""\n[perceiver]\nname = "newer"\n'
    with pytest.raises(DriveError, match=r"its companion\.toml:4: .*: name one with --config"):
        config_of(recording)


def test_what_is_not_there_is_said_before_references_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "companion.toml").write_text('[vehicle]\nfile = ""\n')
    config = ["--config", str(tmp_path / "companion.toml")]
    for where, why in (
        ("nowhere", "is no folder, and no video"),
        ("nowhere.mcap", "nowhere.mcap is not there"),
    ):
        assert main(["replay", where, *config]) == 2
        assert why in capsys.readouterr().err
    assert main(["replay", str(DRIVE), "--refs", str(tmp_path / "typo.jsonl")]) == 2
    assert "typo.jsonl is not there" in capsys.readouterr().err
    drive = tmp_path / "drive"
    drive.mkdir()
    (drive / "1.jpg").write_bytes(b"torn")
    monkeypatch.chdir(drive)
    for where in (".", f"folder:{drive}"):
        assert main(["replay", where, *config]) == 2
        assert f"{drive}.refs.jsonl is not there" in capsys.readouterr().err
    assert main(["replay", ".", "--update-refs", *config]) == 2
    assert "no frame that can be judged again" in capsys.readouterr().err
    assert not Path(f"{drive}.refs.jsonl").exists()


def test_a_frame_that_was_judged_with_taps_is_not_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tapped = tmp_path / "tapped.mcap"
    with tapped.open("wb") as file:
        copy = Copy(file)
        for one in messages(DRIVE):
            if one.channel.topic == "/words":
                one.message.data = json.dumps({**json.loads(one.message.data), "taps": {"bush": 2}}).encode()
            copy.add(one)
        copy.finish()
    code, figures, said = replayed(capsys, str(tapped))
    assert (code, figures["frames"]) == (1, 0)
    assert "nothing could be compared" in said
    assert figures["left_out"] == {"judged with tapped words, which are not recorded": 17}


def test_the_configuration_of_a_rover_whose_secrets_were_left_out_can_be_used(tmp_path: Path) -> None:
    rover = tmp_path / "companion.toml"
    rover.write_text(
        '[vehicle]\nfile = ""\n[web]\nlisten = "0.0.0.0:8191"\ntoken = "0123456789abcdef"\n'
        '[roi]\nleft = 0.4\n[link]\nurl = "udpout:127.0.0.1:14550"\n'
        '[link.more.second]\nurl = "udpin:127.0.0.1:14551"\n'
    )
    rover.chmod(0o600)
    recording = RecordedDrive(DRIVE)
    recording.config = format_config(load_config(rover))
    assert "0123456789abcdef" not in recording.config
    assert config_of(recording).roi.left == 0.4


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"rubbish")
    with pytest.raises(DriveError, match="holds no frames of a recording"):
        RecordedDrive(tmp_path / "a.mcap")


def test_what_differs_is_named_and_nothing_compared_is_not_the_same() -> None:
    far = ROW._replace(figures={**ROW.figures, "worst_tile": 0.6})
    assert list(compared([far], [ROW]).far) == [("frame 1", "worst_tile", 0.5, 0.6)]
    assert compared([ROW._replace(reasons=())], [ROW]).reasons == ["frame 1"]
    assert compared([ROW._replace(opened=3)], [ROW]).calls == ["frame 1"]
    unknown = ROW._replace(figures={**ROW.figures, "uncertainty": None})
    assert compared([unknown], [ROW]).far == [("frame 1", "uncertainty", 0.5, None)]
    assert compared([ROW], [ROW]).same
    assert not compared([ROW], []).same
    other = ROW._replace(name="frame 2")
    gone = compared([ROW], [ROW, other])
    assert (gone.gone, gone.same) == (["frame 2"], False), "a gate that loses frames is not passed"
    assert "not judged any more: 1 frames: frame 2" in list(gone.lines())
    no_number = ROW._replace(figures={**ROW.figures, "uncertainty": float("nan")})
    assert not compared([no_number], [ROW]).same
    assert not ReplayComparison(OF_REFERENCES).same


NUMBERS = st.none() | st.floats(0, 1).map(lambda value: round(value, 5))


@pytest.mark.slow
@given(
    st.lists(
        st.builds(
            JudgementRow,
            st.text(max_size=20),
            st.fixed_dictionaries(dict.fromkeys(FIGURES, NUMBERS)),
            st.lists(st.sampled_from(["blocked", "unknown_object"])).map(tuple),
            st.integers(0, 9),
        ),
        max_size=4,
    )
)
def test_references_are_read_as_they_were_written(
    tmp_path_factory: pytest.TempPathFactory, rows: list[JudgementRow]
) -> None:
    path = tmp_path_factory.getbasetemp() / "rows.jsonl"
    assert write_rows(path, rows) == len(rows)
    assert read_rows(path) == rows


@given(st.binary(max_size=60))
def test_any_bytes_hold_a_picture_or_are_refused(data: bytes) -> None:
    content = {"timestamp": 5, "data": data, "format": "jpeg", "frame_id": "camera"}
    packed = encode("foxglove.CompressedImage", content)
    assert jpeg_of(packed) == data
    for end in range(len(packed)):
        with contextlib.suppress(ValueError):
            assert jpeg_of(packed[:end]) == data


@settings(max_examples=50)
@given(st.binary(max_size=80))
def test_rubbish_is_no_picture(packed: bytes) -> None:
    try:
        assert jpeg_of(packed) in packed
    except ValueError:
        return


@pytest.mark.parametrize(
    "told", [{"region": {"left": 2}}, {"tile_share": "wide"}, {"thresholds": {"roi": "high"}}, {"region": []}]
)
def test_settings_that_cannot_be_are_refused(told: dict[str, Any]) -> None:
    with pytest.raises(DriveError, match="recorded settings cannot be used"):
        settings_of(told, Settings())
