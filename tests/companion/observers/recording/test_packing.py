"""Incidents that are packed on request: by a real process, whatever happens to it."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest

pytest.importorskip("mcap")

from mcap.reader import make_reader

from companion.config import Config
from companion.config.schema import JournalSection, RecordingSection
from companion.observers.recording import packing
from companion.observers.recording.contents import as_json, image
from companion.observers.recording.foxglove import jpeg_of
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.packer import PAUSE, IncidentPacker, PackingChild
from companion.observers.recording.packing import PackingError, PackingRequest, kept, pack
from companion.observers.recording.ring import LEAST_FREE
from companion.observers.recording.ring_writer import RingWriter
from companion.observers.recording.shortened import FRAME_WIDTH, FRAMES
from companion.observers.recording.topics import TOPICS, Topic
from companion.storage.served_files import ServedFiles
from companion.storage.served_tree import FileError
from companion.wire.ids import Result
from companion.wire.incidents import MOST_KEPT, SHORT, Incidents, read_incidents
from tests.companion.observers.recording.made import BEGAN, NS, opened, status, words
from tests.companion.observers.recording.test_commands import unpacked
from tests.waiting import wait_for

PATIENCE = 60.0
"""Seconds: a process of lowest priority may have to wait for all others."""
SOON = partial(time.sleep, 0.0005)
NOISE = np.random.default_rng(1).integers(0, 255, (60, 120, 3), np.uint8)
PICTURE = cv2.imencode(".jpg", cv2.resize(NOISE, (480, 240)))[1].tobytes()


def recorded(folder: Path, seconds: int = 90) -> None:
    """Record frames with maps and assessments; call 7 opens in the middle."""
    ring = RingWriter(folder / "recordings", 60_000_000)
    ring.begin(0.0)
    said = [words(0.5)]
    for second in range(seconds):
        at = BEGAN + second * NS
        said += [RecordedMessage(Topic.CAMERA, at, image(PICTURE, "jpeg", at), second)]
        said += [
            RecordedMessage(Topic.TRAVERSABILITY, at, image(b"png", "png", at), second),
            status(second, second),
        ]
        tenths = range(0, NS, NS // 10)
        said += [RecordedMessage(Topic.ASSESSMENT, at + part, as_json({"frame": second})) for part in tenths]
        if second == seconds // 2:
            said += [opened(6, second), opened(7, second)]
    for message in said:
        since = (message.at - BEGAN) / NS
        ring.write(message, since)
        ring.tick(since)
    ring.finish(1e6)
    (folder / "calls").mkdir()
    for name in ("7.json", "7.jpg", "7-large.jpg", "7-raw.jpg", "6.json", "6-raw.jpg"):
        (folder / "calls" / name).write_bytes(b"of call " + name.encode())
    (folder / "logs").mkdir()
    (folder / "logs" / "companion.log").write_text("a line of the log\n" * 9000)


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The state of a rover, for all tests: each packs incidents of its own."""
    folder = tmp_path_factory.mktemp("state")
    recorded(folder)
    return folder


def asked(folder: Path, call: int = 7) -> PackingRequest:
    return PackingRequest(str(folder), "config", call, "")


class Packing(NamedTuple):
    """A packer, and the monotonic time at which it believes to be."""

    packer: IncidentPacker
    folder: Path

    def until_done(self, seconds: float = PATIENCE) -> None:
        def done() -> bool:
            self.packer.poll(time.monotonic())
            return self.packer.told.packing is None

        wait_for(done, seconds)

    def files(self) -> list[str]:
        return sorted(os.listdir(self.folder / "incidents"))


def packing_of(folder: Path, **more: Any) -> Packing:
    config = replace(
        Config(), journal=JournalSection(folder=str(folder)), recording=RecordingSection(more.pop("size", 60))
    )
    return Packing(IncidentPacker(config, **more), folder)


@pytest.fixture(autouse=True)
def limits() -> Iterator[None]:
    """`pack` lowers the limit of its process for the size of files."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def topics_of(content: bytes) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for _, channel, message in make_reader(io.BytesIO(content)).iter_messages():
        found.setdefault(channel.topic, []).append(message)
    return found


def test_two_files_are_packed_and_the_short_one_has_few_small_frames_and_no_maps(rover: Path) -> None:
    packed = pack(asked(rover))
    home = rover / "incidents"
    whole, short = (unpacked(home / f"{packed.name}{kind}.zip") for kind in ("", SHORT))
    assert (packed.call, packed.note) == (7, "")
    assert (packed.size, packed.short) == tuple(
        (home / f"{packed.name}{kind}.zip").stat().st_size for kind in ("", SHORT)
    )
    assert packed.short * 10 < packed.size
    assert set(whole) - set(short) == {"calls/7-large.jpg", "calls/6-raw.jpg"}, "only of the call meant"
    assert len(short["logs/companion.log"]) < 32_000 < len(whole["logs/companion.log"])
    all_of_it, some = topics_of(whole["recording.mcap"]), topics_of(short["recording.mcap"])
    names = {one: TOPICS[one].name for one in Topic}
    assert len(all_of_it[names[Topic.CAMERA]]) == 60
    assert len(some[names[Topic.CAMERA]]) == FRAMES
    assert len(all_of_it[names[Topic.ASSESSMENT]]) == 600
    assert len(some[names[Topic.ASSESSMENT]]) == 60
    assert set(all_of_it) - set(some) == {names[Topic.TRAVERSABILITY], names[Topic.STATUS]}
    frame = cv2.imdecode(
        np.frombuffer(jpeg_of(some[names[Topic.CAMERA]][0].data), np.uint8), cv2.IMREAD_COLOR
    )
    assert frame is not None
    assert frame.shape == (FRAME_WIDTH // 2, FRAME_WIDTH, 3)
    assert b"short file" in short["README.txt"]
    assert b"short file" not in whole["README.txt"]


def test_a_recording_is_packed_by_itself_with_the_calls_in_it(rover: Path) -> None:
    packed = pack(asked(rover, -2))
    assert (packed.call, packed.name.partition("-")[2]) == (-2, "R2")
    whole = unpacked(rover / "incidents" / f"{packed.name}.zip")
    (path,) = (rover / "recordings").glob("000002*.mcap")
    frames = topics_of(whole["recording.mcap"])[TOPICS[Topic.CAMERA].name]
    assert [one.sequence for one in frames] == [
        one.sequence for one in topics_of(path.read_bytes())[TOPICS[Topic.CAMERA].name]
    ]
    assert "config.toml" in whole
    with pytest.raises(PackingError, match="it is gone"):
        pack(asked(rover, -99))


@pytest.mark.slow
def test_of_many_incidents_the_newest_stay_and_what_was_left_half_done_goes(rover: Path) -> None:
    home = rover / "incidents"
    home.mkdir(exist_ok=True)
    (home / ".0007-C7.zip").write_bytes(b"half")
    (home / "notes.txt").write_bytes(b"of the owner")
    last = [pack(asked(rover, 0)).number for _ in range(MOST_KEPT + 1)]
    assert last == list(range(last[0], last[0] + MOST_KEPT + 1))
    assert [one.number for one in kept(rover)] == last[:0:-1]
    assert len(os.listdir(home)) == 2 * MOST_KEPT + 1, "and what is none of ours"
    assert not (home / ".0007-C7.zip").exists()
    (home / "notes.txt").unlink()


def test_what_is_not_recorded_any_more_is_refused_and_what_has_a_record_is_packed_without(
    tmp_path: Path,
) -> None:
    with pytest.raises(PackingError, match="nothing of it is recorded any more"):
        pack(asked(tmp_path, 9))
    (tmp_path / "calls").mkdir()
    (tmp_path / "calls" / "9.json").write_text("{}")
    assert pack(asked(tmp_path, 9)).note == "without a recording: nothing was recorded then"
    off = asked(tmp_path, 0)._replace(not_recorded="switched off by [recording] size")
    assert pack(off).note == "without a recording: switched off by [recording] size"


@pytest.mark.slow
def test_a_request_that_leads_to_no_file_deletes_none(rover: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    while len(kept(rover)) < MOST_KEPT:
        pack(asked(rover, 0))
    before = kept(rover)
    with pytest.raises(PackingError, match="nothing of it is recorded any more"):
        pack(asked(rover, 9))
    assert kept(rover) == before
    one = packing_of(rover)
    one.packer.ask(9, time.monotonic())
    one.until_done()
    assert one.packer.told.failed == (9, "nothing of it is recorded any more, and its record is gone")
    assert one.packer.told.packed == tuple(before), "and all are still told of"
    monkeypatch.setattr(packing, "LARGEST", 200_000)
    with pytest.raises(PackingError, match="larger than 0 MB"):
        pack(asked(rover))
    assert kept(rover) == before
    monkeypatch.setattr(packing, "LEAST_FREE", 1 << 60)
    with pytest.raises(PackingError, match="the disk is full"):
        pack(asked(rover))
    assert kept(rover) == before


def test_the_room_of_the_oldest_counts_on_a_full_disk(rover: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    while len(kept(rover)) < MOST_KEPT:
        pack(asked(rover))
    oldest = kept(rover)[-1]
    least = 32 << 20
    nearly_full = shutil.disk_usage(rover)._replace(free=LEAST_FREE + 2 * least - 2)
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: nearly_full)
    monkeypatch.setattr(packing, "_LEAST", least)
    assert pack(asked(rover, 0)) in kept(rover)
    assert oldest not in kept(rover)


def test_a_full_disk_is_said_and_nothing_half_done_stays(
    rover: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sorted(os.listdir(rover / "incidents")) if (rover / "incidents").exists() else []
    monkeypatch.setattr(packing, "LARGEST", 200_000)
    with pytest.raises(PackingError, match="larger than 0 MB: use `companion incident`"):
        pack(asked(rover))
    assert all(name in before for name in os.listdir(rover / "incidents"))
    monkeypatch.setattr(packing, "LEAST_FREE", 1 << 60)
    with pytest.raises(PackingError, match="the disk is full"):
        pack(asked(rover))


def test_on_request_a_process_of_lowest_priority_packs_one_at_a_time(rover: Path) -> None:
    one = packing_of(rover)
    began = time.monotonic()
    assert one.packer.ask(7, began) == (Result.APPLIED, "C7 is being packed")
    assert time.monotonic() - began < 0.5, "nothing waits for it"
    assert one.packer.document()["packing"] == "C7"
    child = one.packer._child
    assert child is not None
    wait_for(lambda: child.pid is not None and os.getpriority(os.PRIO_PROCESS, child.pid) == 19, PATIENCE)
    assert one.packer.ask(7, began)[0] is Result.APPLIED, "the same one"
    assert one.packer.ask(8, began) == (Result.REFUSED, "C7 is being packed: ask again when it is done")
    one.until_done()
    newest = one.packer.told.newest(7)
    assert newest is not None
    assert f"{newest.name}.zip" in one.files()
    now = time.monotonic()
    assert one.packer.ask(7, now) == (Result.APPLIED, "C7 was packed just now")
    result, text = one.packer.ask(0, now)
    assert (result, text.startswith("one was asked for just now: ask again in ")) == (Result.REFUSED, True)
    told = read_incidents(json.dumps(one.packer.document()).encode())
    assert told == one.packer.told
    assert packing_of(rover).packer.told.packed[0] == newest._replace(note=""), "after a restart, too"
    assert one.packer.ask(0, now + PAUSE)[0] is Result.APPLIED
    one.packer.close()


SAYS = "import socket, sys; s = socket.socket(fileno=int(sys.argv[1])); s.recv(99999); s.send({})"


def child_of(script: str) -> Callable[[], PackingChild]:
    return lambda: PackingChild((sys.executable, "-c", script))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "why"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "packing ended with SIGKILL"),
        (
            "import time; time.sleep(60)",
            "it made no progress for 1 s: the disk hangs, or the computer is busy",
        ),
        (SAYS.format("b'rubbish'"), "packing failed"),
        (SAYS.format("b'[' * 9000"), "packing failed"),
    ],
)
def test_a_process_that_fails_is_said_and_the_next_request_starts_another(
    tmp_path: Path, script: str, why: str
) -> None:
    one = packing_of(tmp_path, launch=child_of(script), stalled=1.0)
    began = time.monotonic()
    one.packer.ask(7, began)
    one.until_done()
    assert one.packer.told.failed == (7, why)
    assert one.packer.document()["failed"] == {"what": "C7", "why": why}
    assert one.packer.ask(7, time.monotonic())[0] is Result.REFUSED, "not at once"
    assert one.packer.ask(7, time.monotonic() + PAUSE)[0] is Result.APPLIED
    assert "failed" not in str(one.packer.told.failed)
    one.packer.close()


WORKS = "import time\nwhile True: time.process_time()"


def test_a_process_that_works_is_waited_for_until_the_longest_time_and_can_be_ended(tmp_path: Path) -> None:
    one = packing_of(tmp_path, launch=child_of(WORKS), stalled=10.0, longest=100.0)
    one.packer.ask(7, 0.0)
    child = one.packer._child
    assert child is not None
    for looked in range(11, 100, 11):
        worked, deadline = child.cpu_seconds(), time.monotonic() + PATIENCE
        while child.cpu_seconds() <= worked:
            assert time.monotonic() < deadline
        one.packer.poll(float(looked))
        assert one.packer.told.packing == 7, looked
    one.packer.poll(101.0)
    assert one.packer.told.failed == (7, "it took longer than 100 s: use `companion incident`")
    assert child.ends_within(PATIENCE)
    one.packer.ask(7, 101.0 + PAUSE)
    child = one.packer._child
    assert child is not None
    one.packer.close()
    assert child.ends_within(PATIENCE)
    assert child.ended() == "SIGKILL"


def test_a_process_that_cannot_be_started_is_told_to_who_asks(tmp_path: Path) -> None:
    def refuses() -> PackingChild:
        raise OSError("no process left")

    one = packing_of(tmp_path, launch=refuses)
    assert one.packer.ask(7, 0.0) == (Result.REFUSED, "packing cannot be started: no process left")
    assert one.packer.told.packing is None


@pytest.mark.slow
def test_what_a_killed_process_leaves_is_served_to_nobody_and_goes_with_the_next(rover: Path) -> None:
    one = packing_of(rover)
    one.packer.ask(7, time.monotonic())
    child = one.packer._child
    assert child is not None
    home = rover / "incidents"
    wait_for(lambda: list(home.glob(".*.zip")), PATIENCE, turn=SOON)
    assert child.pid is not None
    os.kill(child.pid, signal.SIGKILL)
    one.until_done()
    left = [name for name in os.listdir(home) if name.startswith(".")]
    assert one.packer.told.failed == (7, "packing ended with SIGKILL")
    assert left
    pack(asked(rover))
    assert not [name for name in os.listdir(home) if name.startswith(".")]


@pytest.mark.slow
def test_an_incident_that_is_cancelled_leaves_nothing_behind_and_the_older_ones_stay(rover: Path) -> None:
    while len(kept(rover)) < MOST_KEPT:
        pack(asked(rover, 0))
    before = kept(rover)
    one = packing_of(rover)
    assert one.packer.cancel(7, time.monotonic()) == (Result.REFUSED, "nothing is being packed")
    one.packer.ask(7, time.monotonic())
    child = one.packer._child
    assert child is not None
    wait_for(lambda: any(name.startswith(".") for name in one.files()), PATIENCE, turn=SOON)
    assert child.pid is not None
    os.kill(child.pid, signal.SIGSTOP)
    now = time.monotonic()
    assert one.packer.cancel(8, now) == (Result.REFUSED, "C7 is being packed, not C8")
    assert one.packer.cancel(7, now) == (Result.APPLIED, "C7 is being cancelled")
    assert one.packer.cancel(7, now)[0] is Result.APPLIED, "said twice"
    assert one.packer.ask(7, now) == (Result.REFUSED, "C7 is being cancelled: ask again in 10 s")
    assert one.packer.told.packing == 7, "until the process has ended"
    os.kill(child.pid, signal.SIGCONT)
    one.until_done()
    assert one.packer.told == Incidents(failed=(7, "it was cancelled"), packed=tuple(before))
    assert kept(rover) == before
    assert len(one.files()) == 2 * MOST_KEPT
    assert one.packer.ask(7, time.monotonic() + PAUSE)[0] is Result.APPLIED, "another may be packed"
    one.packer.close()


def test_an_incident_can_be_cancelled_before_its_process_runs(rover: Path) -> None:
    one = packing_of(rover)
    one.packer.ask(7, time.monotonic())
    assert one.packer.cancel(7, time.monotonic())[0] is Result.APPLIED
    one.until_done()
    assert one.packer.told.failed == (7, "it was cancelled")


def _ignores_sigterm(pid: int | None) -> bool:
    if pid is None:
        return False
    told = Path(f"/proc/{pid}/status").read_text().split("SigIgn:")[1].split()[0]
    return bool(int(told, 16) >> (signal.SIGTERM - 1) & 1)


def test_a_process_that_does_not_end_when_it_is_cancelled_is_killed(tmp_path: Path) -> None:
    deaf = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(60)"
    one = packing_of(tmp_path, launch=child_of(deaf))
    one.packer.ask(7, 0.0)
    child = one.packer._child
    assert child is not None
    wait_for(lambda: _ignores_sigterm(child.pid), PATIENCE, turn=SOON)
    one.packer.cancel(7, 1.0)
    one.packer.poll(10.0)
    assert one.packer.told.packing == 7
    one.packer.poll(12.0)
    assert one.packer.told.failed == (7, "it was cancelled")
    assert child.ends_within(PATIENCE)
    assert child.ended() == "SIGKILL"


def test_over_mavlink_ftp_incident_files_are_served_and_nothing_else_of_the_folder(rover: Path) -> None:
    packed = pack(asked(rover))
    home = rover / "incidents"
    (home / ".0999-C7.zip").write_bytes(b"half")
    (home / "0998-C7.zip").symlink_to(rover / "calls" / "7.json")
    tree = ServedFiles(rover).tree
    opened = tree.open(f"/incidents/{packed.name}-short.zip")
    assert opened.read(0, opened.size) == (home / f"{packed.name}-short.zip").read_bytes()
    for path in (".0999-C7.zip", "0998-C7.zip", "../calls/7.json", "/calls/7.json", "..", "no-such.zip"):
        with pytest.raises(FileError):
            tree.open(f"/incidents/{path}")
    (home / "0998-C7.zip").unlink()
