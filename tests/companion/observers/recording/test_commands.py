"""`companion record` and `companion incident` as they are typed."""

from __future__ import annotations

import io
import json
import os
import re
import time
import zipfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("mcap")

from mcap.reader import make_reader

from companion.cli import main
from companion.observers.recording import command, incident
from companion.observers.recording.incident import AFTER, BEFORE, README
from companion.observers.recording.mcap_file import McapFile
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.ring_writer import RingWriter
from companion.observers.recording.shortened import Window
from companion.observers.recording.topics import TOPICS
from companion.system.side_process import missing_packages
from companion.wire.incidents import MOST_MEMBERS
from tests.companion.observers.recording.made import BEGAN, NS, frame, opened, status, words

SECRETS = ("sesame-open-sesame", "hunter2", "s3cretkey")
CONFIG = """[camera]
source = "rtsp://admin:hunter2@camera.local/stream"
[vehicle]
file = ""
[link]
signing_key = "signing.key"
[journal]
folder = "state"
[web]
listen = "0.0.0.0:8191"
token = "sesame-open-sesame"
[words]
grass = 1.0
"""


class Rover:
    """A configuration, a state folder, and what is typed."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.state = folder, folder / "state"
        self.config = folder / "companion.toml"
        self.config.write_text(CONFIG)
        self.config.chmod(0o600)
        (folder / "signing.key").write_text("s3cretkey")
        (self.state / "calls").mkdir(parents=True)
        (self.state / "logs").mkdir()
        (self.state / "logs" / "companion.log").write_text("a line of the log\n")
        (self.state / "status.json").write_text('{"state": "ok"}')
        for name in ("7.json", "7.jpg", "7-large.jpg", "7-raw.jpg", "8.json"):
            (self.state / "calls" / name).write_bytes(b"of call " + name.encode())
        self._capsys = capsys

    def record(self, messages: Sequence[RecordedMessage], *, finish: bool = True) -> RingWriter:
        ring = RingWriter(self.state / "recordings", 20_000_000)
        ring.begin(0.0)
        for message in messages:
            at = (message.at - BEGAN) / NS
            ring.write(message, at)
            ring.tick(at)
        if finish:
            ring.finish(1e6)
        return ring

    def type(self, *typed: str, config: bool = True) -> tuple[int, str, str]:
        code = main([*typed, *(["--config", str(self.config)] if config else [])])
        told = self._capsys.readouterr()
        return code, told.out, told.err


@pytest.fixture
def rover(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Rover:
    monkeypatch.chdir(tmp_path)
    return Rover(tmp_path, capsys)


def drive(seconds: int) -> list[RecordedMessage]:
    """Words at the beginning, a frame a second, call 7 opens at 100 s."""
    found = [words(0.5)]
    for second in range(seconds):
        found.append(frame(second, second, 500))
        if second == 100:
            found += [status(second, second), opened(7, second)]
    return found


def unpacked(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as packed:
        assert packed.testzip() is None
        return {name: packed.read(name) for name in packed.namelist()}


def seconds_of(content: bytes, topic: str) -> list[float]:
    found = make_reader(io.BytesIO(content)).iter_messages([topic])
    return [(message.log_time - BEGAN) / NS for _, _, message in found]


def test_the_list_says_what_is_in_each_recording(rover: Rover) -> None:
    assert rover.type("record", "list")[1].startswith("0 recordings, 0.0 MB, in ")
    rover.record(drive(150))
    code, said, _ = rover.type("record", "list")
    rows = said.splitlines()
    assert code == 0
    assert rows[0].startswith("3 recordings, 0.")
    assert rows[2].split()[0] == "000001.mcap"
    assert rows[3].split()[0] == "000002-event.mcap"
    assert rows[3].endswith("60  call opened 7")
    told = json.loads(rover.type("record", "list", "--json")[1].splitlines()[-1])
    assert [one["frames"] for one in told["recordings"]] == [60, 60, 30]
    assert told["recordings"][0]["begins"] == BEGAN / NS


def test_a_torn_recording_is_listed_and_repaired(rover: Rover) -> None:
    ring = rover.record(drive(30), finish=False)
    path = rover.state / "recordings" / "000001.mcap"
    assert "(being written, or torn)" in rover.type("record", "list")[1]
    code, _, error = rover.type("record", "repair", str(path), config=False)
    assert (code, "is being written: repair a copy" in error) == (2, True)
    del ring  # its writer is gone
    code, said, _ = rover.type("record", "repair", str(path), config=False)
    assert (code, re.sub(r".*: ", "", said)) == (0, "30 messages are whole, and have an index again\n")
    assert rover.type("record", "repair", str(path), config=False)[1].endswith("whole, left as it is\n")
    code, _, error = rover.type("record", "repair", "nowhere.mcap", config=False)
    assert (code, "there is no such file" in error) == (2, True)
    path.write_bytes(b"rubbish")
    code, _, error = rover.type("record", "repair", str(path), config=False)
    assert (code, "no message in it can be read" in error) == (2, True)
    assert path.read_bytes() == b"rubbish"


def test_an_incident_has_all_around_a_call_and_no_secret(rover: Rover) -> None:
    rover.record(drive(200))
    code, said, _ = rover.type("incident", "C7")
    assert code == 0
    assert said.startswith("incident-C7.zip: ")
    found = unpacked(rover.folder / "incident-C7.zip")
    assert set(found) == {
        "README.txt",
        "recording.mcap",
        "config.toml",
        "versions.json",
        "status.json",
        "logs/companion.log",
        *(f"calls/{name}" for name in ("7.json", "7.jpg", "7-large.jpg", "7-raw.jpg")),
    }
    assert seconds_of(found["recording.mcap"], "/camera") == list(range(100 - int(BEFORE), 100 + int(AFTER)))
    held = list(make_reader(io.BytesIO(found["recording.mcap"])).iter_messages(["/words"]))
    assert json.loads(held[0][2].data)["words"] == {"grass": 0.5}
    assert held[0][2].log_time == BEGAN + (100 - round(BEFORE)) * NS, "what held then, though said before"
    assert json.loads(found["versions.json"])["companion"]
    whole = (rover.folder / "incident-C7.zip").read_bytes() + b"".join(found.values())
    for secret in SECRETS:
        assert secret.encode() not in whole
    assert b"camera.local" in found["config.toml"]
    code, _, error = rover.type("incident", "7")
    assert (code, "is there already: name another one with --out" in error) == (2, True)


def test_an_incident_of_the_last_seconds_ends_with_the_newest_message(rover: Rover) -> None:
    rover.record(drive(130), finish=False)
    code, _, _ = rover.type("incident", "--last", "40s", "--out", "found.zip")
    assert code == 0
    found = unpacked(rover.folder / "found.zip")
    seconds = seconds_of(found["recording.mcap"], "/camera")
    assert len(seconds) == 41
    assert seconds[-1] >= 127, "all but what was not flushed"
    assert "calls/7.json" in found, "its call is in that time"


def test_without_a_recording_the_rest_is_packed(rover: Rover, monkeypatch: pytest.MonkeyPatch) -> None:
    code, said, _ = rover.type("incident", "C8")
    assert (code, "without a recording: nothing was recorded then" in said) == (0, True)
    assert "calls/8.json" in unpacked(rover.folder / "incident-C8.zip")
    monkeypatch.setattr(command, "missing", lambda: missing_packages({"nowhere": "mcap"}, "record"))
    code, said, _ = rover.type("incident", "--last", "5m")
    assert (code, "mcap not installed" in said) == (0, True)


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["C9"], "nothing of 9 is left"),
        ([], "name a call (C7) or a time (--last 60s)"),
        (["C7", "--last", "3s"], "name a call (C7) or a time"),
        (["drum"], "drum is no call: give C7, H7 or 7"),
        (["--last", "soon"], '"soon" is no time: give 60s, 5m or 1h'),
        (["--last", "0s"], "is no time"),
        (["C7", "--out", "no/folder.zip"], "no such file or directory"),
    ],
)
def test_what_cannot_be_packed_is_said(rover: Rover, typed: list[str], said: str) -> None:
    code, _, error = rover.type("incident", *typed)
    assert (code, said in error) == (2, True), error


def test_a_disk_that_fills_up_leaves_no_half_a_file(rover: Rover, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> dict[str, str]:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(incident, "versions", full)
    code, _, error = rover.type("incident", "C7")
    assert (code, "no space left on device" in error) == (2, True)
    assert not list(rover.folder.glob("*.zip"))


def test_a_file_that_may_not_be_read_is_left_out_and_said(rover: Rover) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may read everything")
    (rover.state / "calls" / "7.jpg").chmod(0)
    assert "left out: " in rover.type("incident", "C7")[1]


def test_an_incident_beside_a_ring_that_deletes_is_no_error(rover: Rover) -> None:
    rover.record(drive(150))
    windows = incident.around_call(rover.state, 7)
    (rover.state / "recordings" / "000002-event.mcap").unlink()
    packed = incident.write_incident(Path("out.zip"), rover.state, "", windows, [7], "a call")
    assert 0 < packed.messages < 60


def test_no_more_is_packed_than_a_console_takes(rover: Rover) -> None:
    for number in range(1, 1 + MOST_MEMBERS):
        (rover.state / "calls" / f"{number}.json").write_text("{}")
    incident.write_incident(Path("out.zip"), rover.state, "", [], range(1, 2 * MOST_MEMBERS), "many")
    with zipfile.ZipFile("out.zip") as packed:
        names = packed.namelist()
    assert len(names) == MOST_MEMBERS


@given(st.lists(st.tuples(st.integers(0, 100), st.integers(1, 30)), max_size=8))
def test_windows_that_overlap_are_one(pairs: list[tuple[int, int]]) -> None:
    found: list[Window] = [(begin, begin + length) for begin, length in pairs]
    merged = incident._merged(found)
    inside = {at for begin, end in found for at in range(begin, end)}
    assert {at for begin, end in merged for at in range(begin, end)} == inside
    assert all(one[1] < other[0] for one, other in pairwise(merged))


def test_the_readme_names_what_is_there() -> None:
    text = README.format(what="x")
    assert all(name in text for name in ("recording.mcap", "config.toml", "versions.json", "calls/", "logs/"))


def test_a_list_of_a_hundred_recordings_is_quick(rover: Rover) -> None:
    folder = rover.state / "recordings"
    folder.mkdir()
    for number in range(1, 101):
        file = McapFile(folder / f"{number:06d}.mcap", 1_000_000)
        file.add(status(number, number))
        file.finish()
    began = time.process_time()
    assert rover.type("record", "list")[1].startswith("100 recordings")
    assert time.process_time() - began < 2.0


def test_the_page_lists_every_topic() -> None:
    page = (Path(__file__).parents[4] / "docs" / "recording.md").read_text()
    for row in TOPICS.values():
        assert f"| `{row.name}` | {row.schema} | {row.does}" in page


def test_the_shipped_layout_names_topics_and_fields_that_there_are() -> None:
    layout = (Path(__file__).parents[4] / "config" / "foxglove" / "anytraverse.json").read_text()
    assert set(re.findall(r'"(\w+![a-z]+)": \{', layout)) == set(re.findall(r'": "(\w+![a-z]+)"', layout))
    named = {row.name: row for row in TOPICS.values()}
    paths = set(re.findall(r'"(/[a-z/]+(?:\.\w+)?)"', layout))
    assert {"/camera", "/maps/traversability", "/assessment.uncertainty", "/state.open"} <= paths
    for path in paths:
        topic, _, field = path.partition(".")
        assert not field or field in named[topic].fields, path
        assert topic in named
