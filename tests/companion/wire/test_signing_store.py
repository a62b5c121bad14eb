import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from companion.link.signing import SigningClock
from companion.vehicle.state import SOFTWARE_MADE
from companion.wire.signing import DAY, EPOCH, MAX_STREAMS, REPLAY, TICKS, Stream, ticks
from companion.wire.signing_store import NAME, RESERVE, SYNC_EVERY, TimestampFile

BOOT, NEXT_BOOT = bytes([1] * 16), bytes([2] * 16)
WALL = 1_790_000_000.0
NOW = ticks(WALL)
GROUND = Stream(255, 190, 0)


def hear(file: TimestampFile, stream: Stream, timestamp: int, clock: int | None = NOW) -> str:
    reason = file.timestamps.check(stream, timestamp, clock)
    if not reason:
        file.keep(stream)
    return reason


def test_after_a_kill_everything_heard_is_old_and_the_very_next_frame_is_new(tmp_path: Path) -> None:
    before = TimestampFile(tmp_path, BOOT)
    streams = [Stream(1, 1, 0), GROUND, Stream(255, 230, 1)]
    heard = [(streams[count % 3], NOW + count) for count in range(1_000)]
    assert all(hear(before, *one) == "" for one in heard)
    after = TimestampFile(tmp_path, BOOT)
    assert after.notice == ""
    assert {hear(after, *one) for one in heard} == {REPLAY}
    assert [hear(after, stream, NOW + 1_000 + count) for count, stream in enumerate(streams)] == [""] * 3


_CHILD = """
import sys
from pathlib import Path
from companion.wire.signing_store import TimestampFile
from companion.wire.signing import Stream
file = TimestampFile(Path(sys.argv[1]))
for at in range(int(sys.argv[2]), 1 << 47):
    file.timestamps.check(Stream(255, 190, 0), at, None)
    file.keep(Stream(255, 190, 0))
    own = file.timestamps.next(Stream(1, 191, 0), 0)
    file.keep(Stream(1, 191, 0))
    file.tick(at / 1000)
    print(at, own, flush=True)
"""


def test_a_killed_process_has_kept_all_that_it_told(tmp_path: Path) -> None:
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
    assert after.timestamps.next(Stream(1, 191, 0), 0) > own


def test_after_a_power_cut_all_counts_as_newer_by_what_may_have_been_lost(tmp_path: Path) -> None:
    before = TimestampFile(tmp_path, BOOT)
    hear(before, GROUND, NOW)
    after = TimestampFile(tmp_path, NEXT_BOOT)
    assert hear(after, GROUND, NOW + RESERVE) == REPLAY
    assert hear(after, GROUND, NOW + RESERVE + 1) == ""
    assert after.timestamps.next(Stream(1, 191, 0), 0) > NOW + RESERVE


def test_after_a_power_cut_one_frame_of_ours_lets_a_peer_that_only_counts_on_be_heard(tmp_path: Path) -> None:
    hear(TimestampFile(tmp_path, BOOT), GROUND, NOW)
    after = TimestampFile(tmp_path, NEXT_BOOT)
    ours = after.timestamps.next(Stream(1, 191, 0), NOW + 1)
    assert hear(after, GROUND, ours + 1) == ""


def test_after_a_clean_end_nothing_is_reckoned_on(tmp_path: Path) -> None:
    before = TimestampFile(tmp_path, BOOT)
    hear(before, GROUND, NOW)
    before.close()
    after = TimestampFile(tmp_path, NEXT_BOOT)
    assert hear(after, GROUND, NOW) == REPLAY
    assert hear(after, GROUND, NOW + 1) == ""


def test_restarts_do_not_drive_the_time_ahead(tmp_path: Path) -> None:
    for _ in range(20):
        file = TimestampFile(tmp_path, BOOT)
        hear(file, GROUND, file.timestamps.last + 1)
        file.timestamps.next(Stream(1, 191, 0), NOW)
    assert file.timestamps.last < NOW + 100


def test_more_streams_than_the_file_holds_are_forgotten_and_not_let_in_again(tmp_path: Path) -> None:
    before = TimestampFile(tmp_path, BOOT)
    heard = [(Stream(1 + count // 200, 1 + count % 200, 3), NOW + count) for count in range(3 * MAX_STREAMS)]
    assert all(hear(before, *one) == "" for one in heard)
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
        content = bytearray((tmp_path / NAME).read_bytes())
        damaged = bytes(content[: chance.randrange(len(content))]) if count % 2 else None
        if damaged is None:
            content[chance.randrange(64)] ^= 1 << chance.randrange(8)
            damaged = bytes(content)
        (tmp_path / NAME).write_bytes(damaged)
        after = TimestampFile(tmp_path, BOOT, clock=last + 7)
        assert "damaged" in after.notice
        assert hear(after, GROUND, last) == REPLAY
        assert hear(after, Stream(9, 9, 9), last + 7) == REPLAY
        assert hear(after, GROUND, after.timestamps.last + 1) == ""
        assert TimestampFile(tmp_path, BOOT).notice == ""


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
        file.tick(now)
        if file._syncing is not None:
            file._syncing.join()
    assert synced == [0.0, *(SYNC_EVERY * count for count in range(1, 7))]


def test_a_jump_beyond_the_reserve_is_put_on_disk_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    file = TimestampFile(tmp_path, BOOT)
    monkeypatch.setattr(os, "fdatasync", synced.append)
    for count, jump in enumerate((0, 1, 2 * RESERVE, 2 * RESERVE + 1)):
        hear(file, GROUND, NOW + jump)
        file.tick(count / 10)
        if file._syncing is not None:
            file._syncing.join()
    assert len(synced) == 2


def test_a_disk_that_takes_nothing_is_trouble_and_no_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    file = TimestampFile(tmp_path, BOOT)
    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", full)
        assert hear(file, GROUND, NOW) == ""
    assert file.trouble == "No space left on device"
    hear(file, GROUND, NOW + 1)
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
