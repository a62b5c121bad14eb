"""Recordings of a minute in a ring: never above its size, whole for themselves, and no trouble to others."""

from __future__ import annotations

import errno
import json
import os
import shutil
import threading
from collections import namedtuple
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("mcap")

from companion.observers.recording import ring_writer
from companion.observers.recording.mcap_file import SMALLEST, McapFile
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.reading import messages, repair, summary, whole
from companion.observers.recording.ring import LEAST_FREE
from companion.observers.recording.ring_writer import LONGEST, RingWriter
from tests.companion.observers.recording.made import frame, opened, status, words

Usage = namedtuple("Usage", "free")
RING = 10 * SMALLEST


def on_disk(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.iterdir())


def topics(path: Path) -> list[str]:
    return [one.channel.topic for one in messages(path)]


STEPS = st.lists(
    st.tuples(st.sampled_from(["status", "frame", "call", "tick", "restart"]), st.integers(0, 60_000)),
    max_size=30,
)


@settings(max_examples=25)
@given(STEPS)
def test_all_recordings_together_are_never_above_the_rings_size(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[str, int]]
) -> None:
    folder = tmp_path_factory.mktemp("ring")
    ring, now = RingWriter(folder, RING), 0.0
    ring.begin(now)
    for number, (step, size) in enumerate(steps * 3):
        now += 7.0
        match step:
            case "status":
                ring.write(status(number, now), now)
            case "frame":
                ring.write(frame(number, now, size), now)
            case "call":
                ring.write(opened(number, now), now)
            case "tick":
                ring.tick(now)
            case "restart":  # as kill -9 leaves it
                ring = RingWriter(folder, RING)
                ring.begin(now)
        assert on_disk(folder) <= RING
        assert ring.report.size <= RING
    ring.finish(now)
    assert on_disk(folder) <= RING
    assert ring.report.trouble == ""
    assert ring.report.lost == 0
    assert all(whole(path) or not list(messages(path)) for path in folder.iterdir())


def test_a_file_never_grows_above_what_it_may_have(tmp_path: Path) -> None:
    for most in (SMALLEST, 3 * SMALLEST):
        file, number = McapFile(tmp_path / f"{most}.mcap", most), 0
        while file.fits(message := frame(number, number, 1000 if number % 3 else 9000)):
            file.add(message)
            number += 1
            if number % 5 == 0:
                file.flush()
        file.finish()
        assert 0.6 * most < (tmp_path / f"{most}.mcap").stat().st_size <= most


def test_each_recording_lasts_a_minute_and_begins_with_what_holds(tmp_path: Path) -> None:
    ring = RingWriter(tmp_path, 8 * 1_000_000)
    ring.begin(0.0)
    ring.write(words(0.5), 0.0)
    for seconds in range(150):
        ring.write(status(seconds, seconds), float(seconds))
        ring.tick(float(seconds))
    ring.finish(150.0)
    first, second, third = sorted(tmp_path.iterdir())
    assert topics(first).count("/status") == LONGEST
    for path in (second, third):
        held = next(messages(path, {"/words"}))
        assert json.loads(held.message.data)["words"] == {"grass": 0.5}
        assert held.message.log_time == summary(path).begin


def test_a_recording_with_an_event_says_so_in_its_name_at_once(tmp_path: Path) -> None:
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    ring.write(status(1), 0.0)
    assert [path.name for path in tmp_path.iterdir()] == ["000001.mcap"]
    ring.write(opened(7), 0.1)
    assert [path.name for path in tmp_path.iterdir()] == ["000001-event.mcap"]
    ring.write(opened(8), 0.2)
    ring.finish(0.3)
    assert topics(tmp_path / "000001-event.mcap") == ["/status", "/decisions", "/decisions"]


def test_around_an_event_recordings_outlive_younger_ones(tmp_path: Path) -> None:
    ring, now = RingWriter(tmp_path, RING), 0.0
    ring.begin(now)
    for minute in range(40):
        now += LONGEST
        ring.write(frame(minute, now, 60_000), now)
        if minute == 4:
            ring.write(opened(7, now), now)
    ring.finish(now)
    numbers = sorted(int(path.name[:6]) for path in tmp_path.iterdir())
    assert numbers[:3] == [4, 5, 6]
    assert numbers[3] > 25
    assert (tmp_path / "000005-event.mcap").exists()


def test_a_clock_that_was_set_begins_a_new_recording(tmp_path: Path) -> None:
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    ring.write(status(1, 0.0), 0.0)
    ring.write(status(2, 86_400.0), 1.0)
    ring.write(status(3, 86_401.0), 2.0)
    ring.finish(3.0)
    assert [len(topics(path)) for path in sorted(tmp_path.iterdir())] == [1, 2]


def test_numbers_go_on_after_a_restart_and_a_torn_recording_is_repaired(tmp_path: Path) -> None:
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    ring.write(status(1), 0.0)
    ring.tick(3.0)
    del ring  # as kill -9 leaves it
    assert not whole(tmp_path / "000001.mcap")
    (tmp_path / ".000001.mcap.part").write_bytes(b"left")
    ring = RingWriter(tmp_path, RING)
    ring.begin(4.0)
    assert whole(tmp_path / "000001.mcap")
    ring.write(status(2), 5.0)
    ring.finish(6.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["000001.mcap", "000002.mcap"]


def test_a_disk_that_is_nearly_full_gets_room_first_from_the_recordings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = [0]

    def usage(_: object) -> Usage:
        return Usage(LEAST_FREE + 3 * SMALLEST - others[0] - on_disk(tmp_path))

    monkeypatch.setattr("companion.observers.recording.ring_writer.shutil.disk_usage", usage)
    ring, now = RingWriter(tmp_path, RING), 0.0
    ring.begin(now)
    for minute in range(6):
        now += LONGEST
        ring.write(frame(minute, now, 60_000), now)
        assert usage(None).free >= LEAST_FREE - SMALLEST
    assert ring.report.trouble == ""
    assert on_disk(tmp_path) < RING // 2, "room was made"
    others[0] = 4 * SMALLEST  # somebody else fills it
    ring.tick(now + 15.0)
    ring.write(status(1, now), now + 16.0)
    assert ring.report.trouble == "less than 200 MiB are free on its disk"
    assert list(tmp_path.iterdir()) == [], "all room is given back"
    assert (ring.report.files, ring.report.size) == (0, 0)
    lost = ring.report.lost
    ring.write(status(2, now), now + 17.0)
    assert ring.report.lost == lost + 1, "it is not tried with each message"
    others[0] = 0
    ring.write(status(3, now), now + 30.0)
    ring.tick(now + 33.0)
    assert (ring.report.trouble, ring.report.lost) == ("", lost + 1)


@pytest.mark.parametrize("call", ["add", "flush", "sync", "finish", "rename"])
def test_a_disk_that_fails_costs_that_recording_and_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    ring.write(status(1), 0.0)

    def fail(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as broken:
        broken.setattr(McapFile, call, fail)
        ring.write(opened(7, 1.0), 1.0)
        ring.tick(15.0)
        ring.finish(16.0)
    assert ring.report.trouble == "no space left on device"
    ring.write(status(2, 40.0), 40.0)
    ring.tick(43.0)
    assert ring.report.trouble == ""
    ring.finish(44.0)
    assert "/status" in topics(sorted(tmp_path.iterdir())[-1])


def test_a_message_that_fits_no_recording_is_lost_alone(tmp_path: Path) -> None:
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    ring.write(frame(1, 0.0, 2 * SMALLEST), 0.0)
    ring.write(status(2, 1.0), 1.0)
    ring.finish(2.0)
    assert ring.report.lost == 1
    assert ring.report.written == 1
    assert ring.report.trouble == ""


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    ring = RingWriter(tmp_path / "file" / "recordings", RING)
    ring.begin(0.0)
    assert ring.report.trouble == "not a directory"
    ring.write(RecordedMessage(*status(1)), 1.0)
    assert ring.report.lost == 1


def test_what_others_put_into_the_folder_is_left_alone_and_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "000001.mcap").mkdir()
    os.mkfifo(tmp_path / "000002.mcap")
    (tmp_path / "000003.mcap").symlink_to("/etc/hostname")
    (tmp_path / "000004.mcap").write_bytes(b"rubbish")
    for name in (".mine.part", "999999999999.mcap", "README"):
        (tmp_path / name).write_text("mine")
    theirs = {path.name for path in tmp_path.iterdir()}
    (tmp_path / "000005.mcap").write_bytes(b"")  # as kill -9 leaves it before its first chunk
    (tmp_path / ".000005.mcap.part").write_bytes(b"left")
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    ring.write(status(1), 0.0)
    ring.finish(1.0)
    assert ring.report.trouble == ""
    assert {path.name for path in tmp_path.iterdir()} == theirs | {"000005.mcap"}
    assert topics(tmp_path / "000005.mcap") == ["/status"]
    assert (tmp_path / "000004.mcap").read_bytes() == b"rubbish"


def test_after_the_last_number_it_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "999999999.mcap").write_bytes(b"x")
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    ring.write(status(1), 0.0)
    assert ring.report.trouble == "999999999.mcap has the last number: move it to another folder"


def test_a_recording_that_cannot_be_repaired_does_not_stop_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(3):
        ring = RingWriter(tmp_path, RING)
        ring._number = number
        ring.write(status(number), 0.0)
        ring.tick(3.0)
        del ring

    def unreadable(path: Path) -> int:
        if path.name == "000001.mcap":
            raise OSError(errno.EIO, "Input/output error")
        return repair(path)

    monkeypatch.setattr(ring_writer, "repair", unreadable)
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    assert [whole(path) for path in sorted(tmp_path.iterdir())] == [False, True, True]
    ring.write(status(9), 0.1)
    assert (ring.report.written, ring.report.lost) == (1, 0)


def test_a_disk_that_takes_no_byte_is_not_filled_with_empty_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise OSError(errno.EDQUOT, "Disk quota exceeded")

    monkeypatch.setattr(McapFile, "flush", fail)
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    for second in range(120):
        ring.write(status(second), float(second))
        ring.tick(float(second))
        assert ring.report.trouble == ("" if second < 2 else "disk quota exceeded")
    assert ring.report.written + ring.report.lost == 120
    assert ring.report.written <= 2, "those that wait"
    assert len(list(tmp_path.iterdir())) <= 1


def test_a_message_that_fits_no_recording_does_not_end_the_one_in_progress(tmp_path: Path) -> None:
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    for number in range(20):
        ring.write(frame(number, number / 100, 2 * SMALLEST), number / 100)
        ring.write(status(number, number / 100), number / 100)
    ring.finish(1.0)
    assert [path.name for path in tmp_path.iterdir()] == ["000001.mcap"]
    assert (ring.report.written, ring.report.lost) == (20, 20)


def test_a_folder_that_somebody_deletes_is_made_again(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    ring = RingWriter(folder, RING)
    ring.begin(0.0)
    ring.write(status(1), 0.0)
    shutil.rmtree(folder)
    ring.write(opened(7, 1.0), 1.0)
    assert ring.report.trouble == "no such file or directory"
    ring.write(status(2, 20.0), 20.0)
    ring.finish(21.0)
    assert (ring.report.trouble, ring.report.written, ring.report.lost) == ("", 1, 2)
    assert [topics(path) for path in folder.iterdir()] == [["/status"]]


def test_how_it_goes_is_told_while_the_disk_keeps_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the kernel does: while a write of a file hangs, asking for its position hangs, too."""
    position, hangs, goes_on = threading.Lock(), threading.Event(), threading.Event()
    size: Any = McapFile.__dict__["size"]

    def flush(_: McapFile) -> None:
        with position:
            hangs.set()
            goes_on.wait(10.0)

    def asked(file: McapFile) -> Any:
        with position:
            return size.fget(file)

    monkeypatch.setattr(McapFile, "flush", flush)
    monkeypatch.setattr(McapFile, "size", property(asked))
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    ring.write(status(1), 0.0)
    disk = threading.Thread(target=ring.tick, args=(3.0,))
    disk.start()
    assert hangs.wait(5.0)
    told = list[int]()
    asking = threading.Thread(target=lambda: told.append(ring.report.written), daemon=True)
    asking.start()
    asking.join(2.0)
    goes_on.set()
    disk.join(5.0)
    assert told == [1]


def test_a_second_recorder_leaves_the_recording_of_the_first_alone(tmp_path: Path) -> None:
    first, second = RingWriter(tmp_path, RING), RingWriter(tmp_path, RING)
    first.begin(0.0)
    first.write(status(1), 0.0)
    first.tick(3.0)
    second.begin(4.0)
    for number, ring in enumerate((first, second, first, second)):
        ring.write(status(number, 5.0), 5.0)
    first.finish(6.0)
    second.finish(6.0)
    assert (first.report.trouble, second.report.trouble) == ("", "")
    assert [len(topics(path)) for path in sorted(tmp_path.iterdir())] == [3, 2]


def test_a_ring_that_was_made_smaller_is_smaller_at_the_next_start(tmp_path: Path) -> None:
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    for minute in range(30):
        ring.write(frame(minute, 60.0 * minute, 60_000), 60.0 * minute)
    del ring  # as kill -9 leaves it
    ring = RingWriter(tmp_path, RING // 4)
    ring.begin(0.0)
    assert 0 < on_disk(tmp_path) <= RING // 4
    ring.write(frame(99, 0.0, 60_000), 0.0)
    ring.finish(1.0)
    assert on_disk(tmp_path) <= RING // 4
    assert (ring.report.trouble, ring.report.lost) == ("", 0)


def test_the_number_of_a_deleted_recording_is_not_given_again(tmp_path: Path) -> None:
    ring = RingWriter(tmp_path, RING)
    ring.begin(0.0)
    for at in (0.0, 2.0):
        ring.write(status(1), at)
        ring.finish(at + 1.0)
    (tmp_path / "000002.mcap").unlink()
    ring.write(status(2), 4.0)
    ring.finish(5.0)
    assert sorted(one.name for one in tmp_path.glob("*.mcap")) == ["000001.mcap", "000003.mcap"]
