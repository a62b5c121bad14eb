"""A recording that ends anywhere gives back all that was flushed before, and its index again."""

from __future__ import annotations

import io
import random
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("mcap")

from mcap.reader import NonSeekingReader, SeekingReader
from mcap.writer import CompressionType, Writer

from companion.observers.recording.mcap_file import McapFile
from companion.observers.recording.reading import messages, read, repair, summary, whole
from tests.companion.observers.recording.made import BEGAN, NS, frame, opened, status, words

FLUSHED: list[tuple[int, int]] = []
"""Bytes of the file, and messages in it, after each flush."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A finished recording."""
    path = tmp_path_factory.mktemp("recorded") / "000001.mcap"
    file, count = McapFile(path, 1 << 22), 0
    FLUSHED.clear()
    for second in range(12):
        for message in (status(second, second), words(0.1 * second, second), frame(second, second, 2000)):
            file.add(message)
            count += 1
        if second == 5:
            file.add(opened(7, second))
            count += 1
        if second % 2:
            file.flush()
            FLUSHED.append((path.stat().st_size, count))
    file.finish()
    return path.read_bytes()


def flushed_before(end: int) -> int:
    return max((count for size, count in FLUSHED if size <= end), default=0)


def test_mcaps_own_readers_agree_on_a_finished_recording(recorded: bytes) -> None:
    indexed = [one[2] for one in SeekingReader(io.BytesIO(recorded), validate_crcs=True).iter_messages()]
    streamed = [one[2] for one in NonSeekingReader(io.BytesIO(recorded)).iter_messages()]
    assert len(indexed) == len(streamed) == FLUSHED[-1][1]
    assert {(one.log_time, one.data) for one in indexed} == {(one.log_time, one.data) for one in streamed}
    assert len(list(read(io.BytesIO(recorded)))) == len(indexed)


@settings(max_examples=150)
@given(st.floats(0, 1))
def test_cut_at_any_byte_all_that_was_flushed_is_read(recorded: bytes, share: float) -> None:
    end = round(share * len(recorded))
    found = list(read(io.BytesIO(recorded[:end])))
    assert len(found) >= flushed_before(end)
    whole_ones = [one.message for one in read(io.BytesIO(recorded))]
    assert [one.message for one in found] == whole_ones[: len(found)]


@settings(max_examples=60)
@given(st.randoms(use_true_random=False), st.integers(1, 40))
def test_any_damage_is_an_early_end_and_no_error(recorded: bytes, rng: random.Random, times: int) -> None:
    damaged = bytearray(recorded)
    for _ in range(times):
        damaged[rng.randrange(len(damaged))] = rng.randrange(256)
    known = {(one.message.log_time, one.message.data) for one in read(io.BytesIO(recorded))}
    found = list(read(io.BytesIO(bytes(damaged))))
    assert all((one.message.log_time, one.message.data) in known for one in found)


@settings(max_examples=100)
@given(st.randoms(use_true_random=False), st.integers(1, 40))
def test_any_damage_of_a_finished_recording_is_no_error_and_invents_nothing(
    recorded: bytes, tmp_path_factory: pytest.TempPathFactory, rng: random.Random, times: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.mcap"
    damaged = bytearray(recorded)
    index_begins = FLUSHED[-1][0]
    for _ in range(times):
        damaged[rng.randrange(rng.choice((0, index_begins)), len(damaged) - 8)] = rng.randrange(256)
    path.write_bytes(damaged)
    known = {one.message.data for one in read(io.BytesIO(recorded))}
    assert whole(path)
    assert {one.message.data for one in messages(path)} <= known
    summary(path)


@pytest.mark.parametrize("finished", [True, False])
def test_a_damaged_chunk_costs_what_is_in_it_and_nothing_behind(
    recorded: bytes, tmp_path: Path, *, finished: bool
) -> None:
    end = len(recorded) if finished else FLUSHED[-1][0]
    damaged = bytearray(recorded[:end])
    damaged[(FLUSHED[1][0] + FLUSHED[2][0]) // 2] ^= 0xFF
    path = tmp_path / "000001.mcap"
    path.write_bytes(damaged)
    gone = FLUSHED[2][1] - FLUSHED[1][1]
    assert len(list(messages(path))) == FLUSHED[-1][1] - gone


@pytest.mark.slow
@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("finished", [True, False])
def test_a_chunk_that_unpacks_to_far_more_than_ours_is_left_out(
    tmp_path: Path, compression: CompressionType, *, finished: bool
) -> None:
    path = tmp_path / "000001.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start()
        channel = writer.register_channel("/status", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.flush()
        writer.add_message(channel, 2, bytes(200 << 20), 2)
        if finished:
            writer.finish()
    assert path.stat().st_size < 2 << 20
    tracemalloc.start()
    try:
        assert [one.message.data for one in messages(path)] == [b"{}"]
        assert tracemalloc.get_traced_memory()[1] < 150 << 20
    finally:
        tracemalloc.stop()


@given(st.binary(max_size=300))
def test_any_bytes_are_no_recording_and_no_error(content: bytes) -> None:
    list(read(io.BytesIO(content)))
    list(read(io.BytesIO(b"\x89MCAP0\r\n" + content)))


@pytest.mark.parametrize("share", [0.3, 0.5, 0.77, 0.999])
def test_a_repaired_recording_is_read_by_its_index(recorded: bytes, tmp_path: Path, share: float) -> None:
    path = tmp_path / "000001.mcap"
    path.write_bytes(recorded[: round(share * len(recorded))])
    count = len(list(messages(path)))
    assert not whole(path)
    assert repair(path) == count >= flushed_before(path.stat().st_size) * (share < 0.9)
    assert whole(path)
    with path.open("rb") as file:
        assert len(list(SeekingReader(file, validate_crcs=True).iter_messages())) == count
    assert [child.name for child in tmp_path.iterdir()] == ["000001.mcap"]
    assert summary(path).finished
    assert sum(summary(path).counts.values()) == count


def test_a_repair_that_fails_leaves_the_file_as_it_is(
    recorded: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "000001.mcap"
    torn = recorded[: len(recorded) // 2]
    path.write_bytes(torn)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("companion.observers.recording.reading.os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        repair(path)
    assert path.read_bytes() == torn
    assert [child.name for child in tmp_path.iterdir()] == ["000001.mcap"]


def test_a_torn_and_a_whole_recording_are_summarized_alike(recorded: bytes, tmp_path: Path) -> None:
    finished, torn = tmp_path / "000001.mcap", tmp_path / "000002.mcap"
    finished.write_bytes(recorded)
    torn.write_bytes(recorded[: FLUSHED[-1][0]])
    one, other = summary(finished), summary(torn)
    assert one.counts == other.counts
    assert (one.begin, one.end) == (other.begin, other.end) == (BEGAN, BEGAN + 11 * NS)
    assert (one.finished, other.finished) == (True, False)


def test_topics_and_times_are_chosen_with_and_without_an_index(recorded: bytes, tmp_path: Path) -> None:
    finished, torn = tmp_path / "000001.mcap", tmp_path / "000002.mcap"
    finished.write_bytes(recorded)
    torn.write_bytes(recorded[: FLUSHED[-1][0]])
    for path in (finished, torn):
        chosen = list(messages(path, {"/words"}, BEGAN + 3 * NS, BEGAN + 5 * NS))
        assert [(one.message.log_time - BEGAN) // NS for one in chosen] == [3, 4]
    assert list(messages(tmp_path / "000003.mcap")) == [], "the ring has deleted it"
