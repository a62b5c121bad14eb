"""What is where in a recording is found without reading it whole, whatever has become of the file."""

from __future__ import annotations

import io
import struct
from collections import Counter
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("mcap")

from companion.observers.recording.index import index_of, messages_in
from companion.observers.recording.mcap_file import McapFile
from companion.observers.recording.reading import messages, read, summary
from companion.observers.recording.records import MAGIC
from tests.companion.observers.recording.made import frame, opened, status, words


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A finished recording of eight chunks. Call 7 opens in the sixth."""
    file = McapFile(tmp_path_factory.mktemp("recorded") / "000001.mcap", 1 << 22)
    for second in range(8):
        for message in (status(second, second), frame(second, second, 2000), words(0.5, second)):
            file.add(message)
        if second == 5:
            file.add(opened(7, second))
        file.flush()
    file.finish()
    return file.path.read_bytes()


class CountedFile(io.BytesIO):
    """A file that counts the bytes read of it."""

    taken = 0

    def read(self, size: int | None = -1) -> bytes:
        found = super().read(size)
        self.taken += len(found)
        return found


@settings(max_examples=80)
@given(st.floats(0, 1))
def test_cut_at_any_byte_the_chunks_are_found_and_their_messages_counted(
    recorded: bytes, share: float
) -> None:
    torn = recorded[: round(share * len(recorded))]
    index = index_of(io.BytesIO(torn))
    expected = Counter(one.channel.topic for one in read(io.BytesIO(torn)))
    told = index.statistics
    counts = dict(told.channel_message_counts) if told is not None else {}
    assert {index.channels[number].topic: count for number, count in counts.items()} == expected


def test_of_a_torn_recording_little_is_read_to_find_what_is_where(recorded: bytes) -> None:
    file = CountedFile(recorded[: round(0.8 * len(recorded))])
    assert len(index_of(file).chunk_indexes) == 7
    assert file.taken < len(file.getvalue()) / 2


def test_a_finished_recording_is_looked_up_in_its_index_alone(recorded: bytes) -> None:
    def searched() -> None:
        raise AssertionError

    assert len(index_of(io.BytesIO(recorded), searched).chunk_indexes) == 8


def test_an_index_that_is_damaged_is_made_again_from_the_chunks(tmp_path: Path, recorded: bytes) -> None:
    whole = index_of(io.BytesIO(recorded))
    begin = int.from_bytes(recorded[-28:-20], "little")
    path = tmp_path / "000001.mcap"
    path.write_bytes(recorded[:begin] + bytes(len(recorded) - begin - 37) + recorded[-37:])
    with path.open("rb") as file:
        assert [one.chunk_start_offset for one in index_of(file).chunk_indexes] == [
            one.chunk_start_offset for one in whole.chunk_indexes
        ]
    assert summary(path).counts["/camera"] == 8
    assert len(list(messages(path, {"/decisions"}))) == 1


@settings(max_examples=120)
@given(st.binary(max_size=200), st.booleans())
def test_rubbish_is_survived(noise: bytes, begins: bool) -> None:
    index = index_of(io.BytesIO(MAGIC + noise + MAGIC if begins else noise))
    assert index.statistics is None or index.chunk_indexes


@settings(max_examples=80)
@given(st.randoms(use_true_random=False), st.integers(1, 30))
def test_a_recording_with_damaged_bytes_is_still_looked_into(
    recorded: bytes, random: Random, count: int
) -> None:
    spoilt = bytearray(recorded)
    for _ in range(count):
        spoilt[random.randrange(len(spoilt))] = random.randrange(256)
    index_of(io.BytesIO(bytes(spoilt)))


def test_a_chunk_that_names_thousands_of_channels_which_it_does_not_tell_is_read_twice_at_most(
    recorded: bytes,
) -> None:
    first = index_of(io.BytesIO(recorded)).chunk_indexes[0]
    chunk = recorded[: first.chunk_start_offset + first.chunk_length]
    names = (b"\x07" + struct.pack("<QHI", 22, number, 16) + bytes(16) for number in range(100, 9000))
    file = CountedFile(chunk + b"".join(names))
    assert len(index_of(file).chunk_indexes) == 1
    assert file.taken < 9000 * 50 + 3 * len(chunk)


def test_whoever_asks_may_end_the_search(recorded: bytes) -> None:
    def late() -> None:
        raise TimeoutError

    with pytest.raises(TimeoutError):
        index_of(io.BytesIO(recorded[:-20]), late)


def test_of_a_chunk_no_more_than_so_many_messages_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    from companion.observers.recording import index

    monkeypatch.setattr(index, "MOST_MESSAGES", 3)
    record = b"\x05" + (22).to_bytes(8, "little") + bytes(22)
    assert len(list(messages_in(10 * record))) == 3
