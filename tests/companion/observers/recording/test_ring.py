"""Which recordings go first."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from companion.observers.recording.ring import RecordingFile, make_room, name_of, recordings, surplus

FOUND = st.lists(
    st.builds(RecordingFile, st.integers(1, 40), st.booleans(), st.integers(0, 100)),
    max_size=20,
    unique_by=lambda one: one.number,
)


def kept_longest(one: RecordingFile, found: list[RecordingFile]) -> bool:
    numbers = {other.number for other in found if other.event}
    newest = max(other.number for other in found)
    return one.number == newest or any(one.number + step in numbers for step in (-1, 0, 1))


@given(FOUND, st.integers(-50, 1000))
def test_the_rest_fits_and_no_more_goes_than_must(found: list[RecordingFile], most: int) -> None:
    gone = surplus(found, most)
    left = sum(one.size for one in found) - sum(one.size for one in gone)
    assert left <= most or len(gone) == len(found)
    assert not gone or left + gone[-1].size > most


@given(FOUND, st.integers(0, 1000))
def test_what_surrounds_an_event_goes_last_and_the_oldest_first(
    found: list[RecordingFile], most: int
) -> None:
    gone = surplus(found, most)
    left = [one for one in found if one not in gone]
    if any(kept_longest(one, found) for one in gone):
        assert all(kept_longest(one, found) for one in left)
    for kind in (True, False):
        numbers = [one.number for one in gone if kept_longest(one, found) is kind]
        assert numbers == sorted(numbers)
        remaining = [one.number for one in left if kept_longest(one, found) is kind]
        assert not numbers or not remaining or max(numbers) < min(remaining)


def test_names_of_other_files_are_left_alone(tmp_path: Path) -> None:
    for name in ("000001.mcap", "000002-event.mcap", "1.mcap", "mine.mcap", "000003.mcap.part", "note.txt"):
        (tmp_path / name).write_bytes(b"x" * 10)
    assert recordings(tmp_path) == [RecordingFile(1, False, 10), RecordingFile(2, True, 10)]  # noqa: FBT003
    assert [one.name for one in recordings(tmp_path)] == [
        name_of(1, event=False),
        name_of(2, event=True),
    ]
    make_room(tmp_path, -1)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "000003.mcap.part",
        "1.mcap",
        "mine.mcap",
        "note.txt",
    ]
    assert recordings(tmp_path / "nowhere") == []
