"""The file of signing timestamps: what a restart may believe, and what a disk may do meanwhile."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from companion.link.signing import SigningClock
from companion.vehicle.state import SOFTWARE_MADE
from companion.wire.signing import DAY, EPOCH, MAX_STREAMS, REPLAY, TICKS, SignedStream, ticks
from companion.wire.signing_store import HANGS_AFTER, NAME, OWN_RESERVE, RESERVE, SYNC_EVERY, TimestampFile
from tests.waiting import wait_for

BOOT, NEXT_BOOT = bytes([1] * 16), bytes([2] * 16)
WALL = 1_790_000_000.0
NOW = ticks(WALL)
GROUND, OWN = SignedStream(255, 190, 0), SignedStream(1, 191, 0)


def hear(file: TimestampFile, stream: SignedStream, timestamp: int, clock: int | None = NOW) -> str:
    return file.timestamps.check(stream, timestamp, clock)


def written(file: TimestampFile, now: float = 0.0) -> None:
    """A turn of the main loop, and what it has written."""
    file.tick(now)
    wait_for(lambda: file._waiting is None and file._waits_since is None)


def test_after_a_kill_everything_heard_is_old_and_the_very_next_frame_is_new(tmp_path: Path) -> None:
    before = TimestampFile(tmp_path, BOOT)
    streams = [SignedStream(1, 1, 0), GROUND, SignedStream(255, 230, 1)]
    heard = [(streams[count % 3], NOW + count) for count in range(1_000)]
    assert all(hear(before, *one) == "" for one in heard)
    written(before)
    after = TimestampFile(tmp_path, BOOT)
    assert after.notice == ""
    assert {hear(after, *one) for one in heard} == {REPLAY}
    assert [hear(after, stream, NOW + 1_000 + count) for count, stream in enumerate(streams)] == [""] * 3


_CHILD = """
import sys
from pathlib import Path
from companion.wire.signing import SignedStream
from companion.wire.signing_store import TimestampFile
file = TimestampFile(Path(sys.argv[1]))
for at in range(int(sys.argv[2]), 1 << 47):
    file.timestamps.check(SignedStream(255, 190, 0), at, None)
    own = file.timestamps.next(SignedStream(1, 191, 0), 0)
    file.tick(at / 1000)
    with file._changed:
        file._changed.wait_for(lambda: file._waits_since is None)
    print(at, own, flush=True)
"""


def test_a_killed_process_has_kept_all_that_it_told_and_goes_on_behind_what_it_did_not(
    tmp_path: Path,
) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", _CHILD, str(tmp_path), str(NOW)], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    told = [child.stdout.readline() for _ in range(500)]
    child.send_signal(signal.SIGKILL)
    told += [line for line in child.stdout.read().splitlines(keepends=True) if line.endswith("\n")]
    child.stdout.close()
    child.wait(10)
    heard, own = map(int, told[-1].split())
    after = TimestampFile(tmp_path)
    assert after.notice == ""
    assert 0 <= after.timestamps.streams[GROUND] - heard <= 2
    assert after.timestamps.next(OWN, 0) > own + OWN_RESERVE


def test_after_a_power_cut_all_counts_as_newer_by_what_may_have_been_lost(tmp_path: Path) -> None:
    before = TimestampFile(tmp_path, BOOT)
    hear(before, GROUND, NOW)
    written(before)
    after = TimestampFile(tmp_path, NEXT_BOOT)
    assert hear(after, GROUND, NOW + RESERVE) == REPLAY
    assert hear(after, GROUND, NOW + RESERVE + 1) == ""
    assert after.timestamps.next(OWN, 0) > NOW + RESERVE


def test_after_a_power_cut_one_frame_of_ours_lets_a_peer_that_only_counts_on_be_heard(tmp_path: Path) -> None:
    before = TimestampFile(tmp_path, BOOT)
    hear(before, GROUND, NOW)
    written(before)
    after = TimestampFile(tmp_path, NEXT_BOOT)
    ours = after.timestamps.next(OWN, NOW + 1)
    assert hear(after, GROUND, ours + 1) == ""


def test_after_a_clean_end_nothing_is_reckoned_on(tmp_path: Path) -> None:
    before = TimestampFile(tmp_path, BOOT)
    hear(before, GROUND, NOW)
    before.close()
    after = TimestampFile(tmp_path, NEXT_BOOT)
    assert hear(after, GROUND, NOW) == REPLAY
    assert hear(after, GROUND, NOW + 1) == ""


def test_a_restart_after_a_kill_drives_the_time_ahead_by_a_second_at_most(tmp_path: Path) -> None:
    for count in range(20):
        file = TimestampFile(tmp_path, BOOT)
        hear(file, GROUND, file.timestamps.last + 1)
        file.timestamps.next(OWN, NOW)
        written(file)
        assert file.timestamps.last <= NOW + count * (OWN_RESERVE + 2) + 2


def test_more_streams_than_the_file_holds_are_forgotten_and_not_let_in_again(tmp_path: Path) -> None:
    before = TimestampFile(tmp_path, BOOT)
    heard = [
        (SignedStream(1 + count // 200, 1 + count % 200, 3), NOW + count) for count in range(3 * MAX_STREAMS)
    ]
    assert all(hear(before, *one) == "" for one in heard)
    written(before)
    size = (tmp_path / NAME).stat().st_size
    after = TimestampFile(tmp_path, BOOT)
    assert after.timestamps.streams == before.timestamps.streams
    assert {hear(after, *one) for one in heard} == {REPLAY}
    assert (tmp_path / NAME).stat().st_size == size


def test_a_damaged_file_is_said_and_lets_in_only_what_is_newer_than_now(tmp_path: Path) -> None:
    chance = random.Random(5)
    for count in range(40):
        file = TimestampFile(tmp_path, BOOT, clock=NOW)
        assert hear(file, GROUND, max(NOW, file.timestamps.last + 1)) == ""
        last = file.timestamps.last
        written(file)
        content = bytearray((tmp_path / NAME).read_bytes())
        damaged = bytes(content[: chance.randrange(len(content))]) if count % 2 else None
        if damaged is None:
            content[chance.randrange(64)] ^= 1 << chance.randrange(8)
            damaged = bytes(content)
        (tmp_path / NAME).write_bytes(damaged)
        after = TimestampFile(tmp_path, BOOT, clock=last + 7)
        assert "damaged" in after.notice
        assert hear(after, GROUND, last) == REPLAY
        assert hear(after, SignedStream(9, 9, 9), last + 7) == REPLAY
        assert hear(after, GROUND, after.timestamps.last + 1) == ""
        assert TimestampFile(tmp_path, BOOT).notice == ""


@pytest.mark.slow
def test_the_file_is_put_on_disk_every_few_seconds_and_only_when_it_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[float] = []
    file = TimestampFile(tmp_path, BOOT)
    now = 0.0
    monkeypatch.setattr(os, "fdatasync", lambda _: synced.append(now))
    for step in range(600):
        now = step / 10
        if now < 30:
            hear(file, GROUND, NOW + step * TICKS // 10)
        written(file, now)
    assert synced == [SYNC_EVERY * count for count in range(7)]


def test_a_jump_beyond_the_reserve_is_put_on_disk_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    file = TimestampFile(tmp_path, BOOT)
    monkeypatch.setattr(os, "fdatasync", synced.append)
    for count, jump in enumerate((0, 1, 2 * RESERVE, 2 * RESERVE + 1)):
        hear(file, GROUND, NOW + jump)
        written(file, count / 10)
    assert len(synced) == 2


def test_the_mark_of_a_clean_end_reaches_the_disk_and_only_after_the_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, done, real = TimestampFile(tmp_path, BOOT), list[str](), os.pwrite

    def write(descriptor: int, content: bytes, at: int) -> int:
        done.append("mark" if content[4:20] == bytes(16) else "rows")
        return real(descriptor, content, at)

    monkeypatch.setattr(os, "pwrite", write)
    monkeypatch.setattr(os, "fdatasync", lambda _: done.append("sync"))
    file.close()
    assert done == ["rows", "sync", "mark", "sync"]


@contextmanager
def hanging(monkeypatch: pytest.MonkeyPatch) -> Iterator[set[str]]:
    """A disk on which no write ends before the block does. Yields the threads that wait for it."""
    released, waits, real = threading.Event(), set[str](), os.pwrite

    def hang(*given: object) -> int:
        waits.add(threading.current_thread().name)
        assert released.wait(30.0)
        return real(*given)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", hang)
        try:
            yield waits
        finally:
            released.set()


def test_a_disk_that_hangs_delays_no_frame_and_is_trouble_while_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, stamps = TimestampFile(tmp_path, BOOT), list[int]()
    with hanging(monkeypatch) as waits:
        for second in range(40):
            assert hear(file, GROUND, NOW + second * TICKS) == ""
            stamps.append(file.timestamps.next(OWN, NOW + second * TICKS))
            file.tick(float(second))
            wait_for(lambda: waits)
            assert bool(file.trouble) == (second > HANGS_AFTER)
        assert file.trouble == "the disk hangs"
        assert waits == {"signing-state"}
    written(file, 40.0)
    assert file.trouble == ""
    assert stamps == sorted(set(stamps))
    assert hear(TimestampFile(tmp_path, BOOT), GROUND, NOW + 39 * TICKS) == REPLAY


def test_a_disk_that_is_slow_and_busy_all_the_time_does_not_hang(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, now = TimestampFile(tmp_path, BOOT), 0.0
    real = os.pwrite

    def slow(*given: object) -> int:
        hear(file, GROUND, NOW + int(now * TICKS) + 1)
        file.tick(now)  # something new always waits
        return real(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "pwrite", slow)
    for second in range(40):
        now = float(second)
        hear(file, GROUND, NOW + second * TICKS)
        file.tick(now)
        wait_for(lambda: file._waiting is None or file._waits_since is None)
        assert file.trouble == ""


def test_a_disk_that_hangs_delays_the_end_a_second_at_most_and_then_it_was_no_clean_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.wire.signing_store.CLOSE_WITHIN", 0.01)
    file = TimestampFile(tmp_path, BOOT)
    hear(file, GROUND, NOW)
    written(file)
    with hanging(monkeypatch):
        file.close()
        assert hear(TimestampFile(tmp_path, NEXT_BOOT), GROUND, NOW + RESERVE) == REPLAY
    file._thread.join(10.0)
    assert not file._thread.is_alive()


def test_a_disk_that_takes_nothing_is_trouble_and_no_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    file = TimestampFile(tmp_path, BOOT)
    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", full)
        assert hear(file, GROUND, NOW) == ""
        written(file)
    assert file.trouble == "No space left on device"
    hear(file, GROUND, NOW + 1)
    written(file)
    assert file.trouble == ""


def test_the_file_is_for_its_owner_alone(tmp_path: Path) -> None:
    TimestampFile(tmp_path, BOOT)
    assert (tmp_path / NAME).stat().st_mode & 0o777 == 0o600


def test_a_clock_that_was_never_set_is_not_believed_until_a_verified_source_tells() -> None:
    wall = [0.0]
    clock = SigningClock(0, lambda: wall[0])
    assert clock.now(5.0) is None
    clock.update(ticks(SOFTWARE_MADE) - 1, 6.0)
    assert clock.now(6.0) is None
    clock.update(NOW, 10.0)
    clock.update(NOW - 50 * TICKS, 11.0)
    assert clock.now(12.0) == NOW + 2 * TICKS
    wall[0] = WALL + 500
    assert clock.now(13.0) == NOW + 500 * TICKS


def test_a_clock_over_a_day_behind_what_was_heard_before_is_not_believed() -> None:
    assert SigningClock(NOW + DAY, lambda: WALL).now(0.0) == NOW
    assert SigningClock(NOW + DAY + 1, lambda: WALL).now(0.0) is None
    assert SigningClock(NOW + DAY + 1, lambda: WALL, lambda: True).now(0.0) == NOW, "the network set it"
    assert EPOCH + ticks(SOFTWARE_MADE) / TICKS == 1_767_225_600
