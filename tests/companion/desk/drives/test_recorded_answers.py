"""The answers of a recording are read as an operator would type them, whatever the recording holds."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from companion.desk.drives.recorded import RecordedDrive
from companion.observers.recording.reading import messages
from companion.wire.typed_answers import read_typed
from tests.companion.desk.drives.record_drive import DRIVE

S = 10**9
OPENED = {"decision": "call opened", "id": 3}
ANY = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-9, 9)
    | st.floats()
    | st.sampled_from(["go", "a: b", "x;\ny", ""]),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["word", "weight", "box"]), inner, max_size=3)
    ),
    max_leaves=8,
)


def answer(*operations: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    return {"request": "Answer", "target": 0, "motion": "go", "operations": list(operations), **more}


def recorded(path: Path, told: Sequence[tuple[int, Mapping[str, Any]]], frames: Sequence[int] = (0,)) -> Path:
    """Write a recording with the first picture of drive.mcap at some times, and decisions and requests."""
    picture = next(one.message.data for one in messages(DRIVE, ["/camera"]))
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        topics = {
            name: writer.register_channel(name, "json", 0) for name in ("/camera", "/decisions", "/requests")
        }
        for number, at in enumerate(frames):
            writer.add_message(topics["/camera"], S + at, picture, S + at, number)
        for at, content in told:
            topic = topics["/requests" if "request" in content else "/decisions"]
            writer.add_message(topic, S + at, json.dumps(content).encode(), S + at)
        writer.finish()
    return path


def test_words_and_taps_are_told_at_the_time_of_their_call(tmp_path: Path) -> None:
    tap = {"frame_id": 7, "box": [0.4, 0.5, 0.6, 0.8], "word": "rock", "weight": -1.0}
    told = [(5 * S, OPENED), (9 * S, answer({"word": "gravel", "weight": 1}, tap, {"word": "bush"}))]
    drive = RecordedDrive(recorded(tmp_path / "a.mcap", told, [0, 4 * S, 8 * S]))
    line = "gravel: 1; tap rock: -1 0.4000 0.5000 0.6000 0.8000; forget bush, go"
    assert drive.answers() == [([frame.at for frame in drive.frames()][1], line)]


def test_decisions_of_one_instant_are_read(tmp_path: Path) -> None:
    told = [(S, OPENED), (S, {"decision": "would hold", "count": 1}), (2 * S, answer())]
    assert [line for _, line in RecordedDrive(recorded(tmp_path / "a.mcap", told)).answers()] == ["go"]


def test_a_call_may_be_answered_in_the_next_file(tmp_path: Path) -> None:
    recorded(tmp_path / "a.mcap", [(S, OPENED)])
    recorded(tmp_path / "b.mcap", [(4 * S, answer()), (5 * S, answer(target=3))], [3 * S])
    assert [line for _, line in RecordedDrive(tmp_path).answers()] == ["go", "go"]


@given(operations=ANY, motion=ANY, number=ANY)
@settings(max_examples=60, deadline=None)
def test_whatever_is_recorded_gives_answers_that_can_be_read(
    tmp_path_factory: Any, operations: Any, motion: Any, number: Any
) -> None:
    odd = answer(target=number, motion=motion) | {"operations": operations}
    listed = answer(operations if isinstance(operations, dict) else {"word": operations})
    told = [(S, {**OPENED, "id": number}), (2 * S, odd), (3 * S, listed)]
    path = recorded(tmp_path_factory.mktemp("odd") / "a.mcap", told)
    for _, line in RecordedDrive(path).answers():
        read_typed(line)
