"""How recordings are read for evidence: as far as there is time, and past what is damaged."""

from __future__ import annotations

import errno
import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer

from companion.desk.evidence.collect import evidence
from companion.desk.evidence.drives import DrivenFacts, read_drives
from companion.desk.evidence.link import link_part
from companion.observers.recording import reading, records
from companion.observers.recording.foxglove import NS
from companion.observers.recording.topics import TOPICS, Topic
from tests.companion.desk.evidence.told import NOON, figures, sources


def recorded(folder: Path, number: int, messages: Sequence[tuple[Topic, float, Mapping[str, Any]]]) -> Path:
    (folder / "recordings").mkdir(exist_ok=True)
    path = folder / "recordings" / f"{number:06d}.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = dict[Topic, int]()
        for topic, at, told in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(TOPICS[topic].name, "json", 0)
            writer.add_message(channels[topic], int(at * NS), json.dumps(told).encode(), int(at * NS))
        writer.finish()
    return path


def heard(at: float) -> tuple[Topic, float, Mapping[str, Any]]:
    told = {"heard_at": at, "system_id": 1, "autopilot": 3, "type": 10}
    return Topic.VEHICLE, NOON + at, told


def test_heartbeats_that_did_not_come_are_told_but_not_the_time_between_recordings(tmp_path: Path) -> None:
    recorded(tmp_path, 1, [heard(10.0), heard(11.0), heard(15.0)])
    recorded(tmp_path, 2, [heard(900.0), heard(901.0)])
    told = link_part(sources(tmp_path, driven=read_drives(tmp_path)))
    name = "between two heartbeats of the autopilot, in one recording, longest"
    (longest,) = [one for one in told.figures if one["name"] == name]
    assert (longest["value"], longest["samples"]) == (4.0, 3)
    assert figures(told.document())["autopilot"] == "system 1, ArduPilot"
    other = link_part(sources(tmp_path, driven=DrivenFacts(files=1, vehicles={(2, 99, 1)})))
    assert figures(other.document())["autopilot"] == "system 2, MAV_AUTOPILOT 99, MAV_TYPE 1"


def test_reading_ends_after_so_many_messages_and_keeps_what_it_has(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        recorded(tmp_path, number, [heard(float(each)) for each in range(10)])
    found = read_drives(tmp_path, most=15)
    assert (found.files, found.unread, len(found.gaps)) == (2, 2, 9 + 4), "one in part, one not at all"


def test_the_time_is_kept_within_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(tmp_path, 1, [heard(float(each)) for each in range(100)])
    now = itertools.count()
    monkeypatch.setattr("time.monotonic", lambda: float(next(now)))
    assert 0 < len(read_drives(tmp_path, longest=30.0).gaps) < 40


@pytest.mark.parametrize("set_by", [-7200.0, 3600.0])
def test_a_clock_that_is_set_while_it_records_makes_the_recorded_time_no_longer(
    tmp_path: Path, set_by: float
) -> None:
    recorded(tmp_path, 1, [heard(each + (set_by if each >= 10 else 0.0)) for each in range(20)])
    assert read_drives(tmp_path).seconds == pytest.approx(18.0)


def test_recordings_that_were_deleted_in_between_are_counted(tmp_path: Path) -> None:
    for number in (3, 4, 7):
        recorded(tmp_path, number, [heard(1.0)])
    assert read_drives(tmp_path).lacking == 2


def test_a_bad_sector_costs_one_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bad, _ = (recorded(tmp_path, number, [heard(1.0)]) for number in (1, 2))
    opened = records.opened

    def failing(path: Path) -> Any:
        if path == bad:
            raise OSError(errno.EIO, "Input/output error", str(path))
        return opened(path)

    monkeypatch.setattr(reading, "opened", failing)
    found = read_drives(tmp_path)
    assert (found.files, found.damaged, found.unread) == (1, 1, 0)
    told = evidence(sources(tmp_path, driven=found), "SHA256:x")
    assert "1 damaged recordings" in [one["what"] for one in told["unknown"]]


def test_with_no_time_left_all_recordings_are_unread_and_that_is_told(driven: Path) -> None:
    found = read_drives(driven.parent / "state", longest=-1.0)
    assert (found.files, found.unread) == (0, 1)
    told = evidence(sources(driven.parent / "state", driven=found), "SHA256:x")
    assert "1 recordings, or the rest of one" in [one["what"] for one in told["unknown"]]


def test_damaged_recordings_are_no_error(driven: Path, tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    (whole,) = (driven.parent / "state" / "recordings").glob("*.mcap")
    content = whole.read_bytes()
    (tmp_path / "recordings" / "000001.mcap").write_bytes(content[:-200])
    (tmp_path / "recordings" / "000002.mcap").write_bytes(content[: len(content) // 2])
    (tmp_path / "recordings" / "000003.mcap").write_bytes(b"rubbish")
    found = read_drives(tmp_path)
    assert (found.files, found.unread) == (3, 0)
    assert len(found.ages) > 0
