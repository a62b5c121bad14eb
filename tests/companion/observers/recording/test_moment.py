"""A moment of a recording: picture, maps, judgement, state and vehicle that belong together, each checked."""

from __future__ import annotations

import io
import random
from base64 import b64decode
from collections.abc import Sequence
from pathlib import Path

import pytest

pytest.importorskip("mcap")

from companion.observers.recording.contents import as_json, image, image_annotations
from companion.observers.recording.index import index_of
from companion.observers.recording.listing import listed
from companion.observers.recording.mcap_file import McapFile
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.moment import Moments
from companion.observers.recording.seeking import Seeker
from companion.observers.recording.topics import Topic
from tests.companion.observers.recording.made import BEGAN, NS, SEEN, opened, words

PNG = b"\x89PNG\r\n\x1a\n" + bytes(8) + (80).to_bytes(4, "big") + (60).to_bytes(4, "big")


def jpeg(number: int) -> bytes:
    """Bytes that no chunk makes smaller."""
    return b"\xff\xd8" + random.Random(number).randbytes(3000)


def said(topic: Topic, second: float, content: bytes, sequence: int = 0) -> RecordedMessage:
    return RecordedMessage(topic, BEGAN + round(second * NS), content, sequence)


def judged_frame(number: int, second: float, picture: bytes | None = None) -> list[RecordedMessage]:
    """A frame with all that belongs to it. It was judged 0.3 s after its capture."""
    at = BEGAN + round(second * NS)
    region = SEEN.roi.worst_tile.box if SEEN.roi is not None and SEEN.roi.worst_tile is not None else None
    assert region is not None
    return [
        said(Topic.CAMERA, second, image(picture or jpeg(number), "jpeg", at), number),
        said(Topic.TRAVERSABILITY, second, image(PNG + b"t", "png", at), number),
        said(Topic.UNCERTAINTY, second, image(PNG + b"u", "png", at), number),
        said(Topic.ANNOTATIONS, second, image_annotations(SEEN, region, "title", at), number),
        said(
            Topic.ASSESSMENT,
            second + 0.3,
            as_json(
                {"frame": number, "ok": False, "reasons": ["unknown_object"], "uncertainty": number / 100}
            ),
            number,
        ),
    ]


def state(name: str, second: float, **more: object) -> RecordedMessage:
    return said(Topic.STATE, second, as_json({"state": name, **more}))


def moments_of(path: Path, messages: Sequence[RecordedMessage], *, flushed: int = 4) -> Moments:
    file = McapFile(path, 1 << 23)
    for number, message in enumerate(messages):
        file.add(message)
        if number % flushed == flushed - 1:
            file.flush()
    file.finish()
    content = io.BytesIO(path.read_bytes())
    index = index_of(content)
    return Moments(Seeker(content, index), index.statistics.message_start_time)


@pytest.fixture
def drive(tmp_path: Path) -> Moments:
    """Twenty frames, one a second; the state changes after 7 s, the words after 12."""
    told = [state("ok", 0.0), words(1.0, 0.0)]
    for second in range(20):
        told += judged_frame(second + 1, float(second))
        told += [state("calling", 7.5, open=3, kind="call", stage="open")] if second == 7 else []
        told += [words(-1.0, 12.5)] if second == 12 else []
        told += [said(Topic.VEHICLE, second + 0.1, as_json({"speed": second / 10, "armed": True}))]
    return moments_of(tmp_path / "000001.mcap", told)


def test_a_moment_has_the_last_frame_until_then_and_what_belongs_to_it(drive: Moments) -> None:
    found = drive.moment(5400)
    assert (found["at"], found["previous"], found["next"], found["frame"]) == (5000, 4000, 6000, 6)
    assert b64decode(found["picture"]) == jpeg(6) == drive.frame(5999)
    assert b64decode(found["traversability"]) == PNG + b"t"
    assert b64decode(found["uncertainty"]) == PNG + b"u"
    assert found["judged"]["uncertainty"] == 0.06
    assert len(found["outlines"][0]) == 4
    assert (found["state"], found["open"], found["speed"]) == ("ok", None, 0.4)


def test_state_and_words_are_those_in_force_however_long_ago_they_began(drive: Moments) -> None:
    late = drive.moment(19_500)
    assert (late["state"], late["open"], late["words"]) == ("calling", 3, {"grass": -1.0})
    assert drive.moment(11_000)["words"] == {"grass": 1.0}


def test_at_its_ends_there_is_nothing_before_and_after(drive: Moments) -> None:
    assert (drive.moment(0)["at"], drive.moment(0)["previous"]) == (0, None)
    last = drive.moment(10**11)
    assert (last["at"], last["next"]) == (19_000, None)


def test_each_frame_is_reached_from_the_one_before(drive: Moments) -> None:
    at: int | None = 0
    seen = []
    while at is not None:
        found = drive.moment(at)
        seen.append(found["frame"])
        at = found["next"]
    assert seen == list(range(1, 21))


def test_what_is_no_picture_is_left_out(tmp_path: Path) -> None:
    huge = PNG[:16] + (60_000).to_bytes(4, "big") + (60_000).to_bytes(4, "big")
    at = BEGAN + NS
    told = [
        *judged_frame(1, 0.0, b"<html>"),
        said(Topic.CAMERA, 1.0, b"no protobuf", 2),
        said(Topic.UNCERTAINTY, 1.0, image(huge, "png", at), 2),
        said(Topic.ANNOTATIONS, 1.0, b"\x12\xff", 2),
        said(Topic.ASSESSMENT, 1.0, b'{"uncertainty": 1e999, "reasons": 5, "roi": []}', 2),
        said(Topic.STATE, 1.0, b'{"state": ["ok"], "open": -7, "reasons": ["\\u001b[2J"]}'),
    ]
    moments = moments_of(tmp_path / "000001.mcap", told)
    assert moments.moment(0)["picture"] == ""
    found = moments.moment(1000)
    assert (found["picture"], found["uncertainty"], found["outlines"]) == ("", "", [])
    assert (found["state"], found["open"], found["reasons"]) == ("", None, ["[2J"])
    assert found["judged"]["uncertainty"] is None


def test_without_a_frame_there_is_the_state_alone(tmp_path: Path) -> None:
    found = moments_of(tmp_path / "000001.mcap", [state("fault", 0.0), state("ok", 5.0)]).moment(6000)
    assert found["state"] == "ok"
    assert "picture" not in found


def test_a_list_has_calls_and_the_begins_of_faults_and_stops_when_it_takes_too_long(tmp_path: Path) -> None:
    told = [opened(7, 1.0), *(state("fault", 20.0 + second) for second in range(3)), state("ok", 24.0)]
    told += [state("fault", 25.0), state("ok", 30.0), state("fault", 50.0)]
    moments_of(tmp_path / "000001.mcap", told)
    found = listed(tmp_path / "000001.mcap")
    assert [one.text for one in found.happened] == ["call opened 7", "fault", "fault"]
    assert [(one.at - BEGAN) // NS for one in found.happened] == [1, 20, 50]
    steps = iter(range(1))  # a call and a fault are in its first chunk

    def check() -> None:
        if next(steps, None) is None:
            raise TimeoutError

    cut = listed(tmp_path / "000001.mcap", check)
    assert (cut.more, len(cut.happened)) == (True, 2)
