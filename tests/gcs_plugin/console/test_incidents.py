"""Incident files in the console: asked for, fetched over the companion's real link, and stored."""

from __future__ import annotations

import io
import json
import random
import struct
import threading
import zipfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from companion.pages.requests import RequestError
from companion.storage.served_tree import Document, Documents
from companion.wire.answers import Acknowledgement, Answer, CancelIncident, PackIncident
from companion.wire.call_report import CallReport
from companion.wire.ids import Motion, Policy, Result, Stage, State
from companion.wire.incidents import MOST_MEMBERS, Incidents, Packed
from companion.wire.payloads import Summary
from gcs_plugin.client.fetch import LIFETIME_S, MAX_BYTES
from gcs_plugin.console import incidents
from gcs_plugin.console.incidents import FOLLOWED_S, MOST_STORED
from gcs_plugin.console.requests import IncidentFileRequest, IncidentRequest, read_request
from gcs_plugin.console.rover_page import RoverPage, read_pages
from tests.companion.observers.page.played import TOKEN
from tests.companion.observers.page.played import Stage as PageStage
from tests.gcs_plugin.console.test_console import Desk
from tests.waiting import wait_for

NAME = "0003-C7-short.zip"


def zipped(size: int) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("noise", random.Random(size).randbytes(size))
    return packed.getvalue()


CONTENT = zipped(30_000)
PACKED = Packed(3, 7, 12_000_000, len(CONTENT))


class Rover:
    """A rover that packs what a test says, and the console's desk."""

    def __init__(
        self,
        call: CallReport,
        summary: Summary,
        folder: Path,
        pages: Mapping[int, RoverPage] | None = None,
    ) -> None:
        self.told = Incidents()
        self.content = CONTENT
        self.folder = folder / "incidents"
        files = Documents(lambda: {NAME: len(self.content)}, lambda _: self.content)
        document = Document(lambda: json.dumps(self.told.document()).encode())
        self.desk = Desk(call, summary, {"incidents.json": document, "incidents": files}, self.folder, pages)
        self.desk.link.link.set_state(State.OK, 0, Policy.HOLD)
        self.desk.announce()
        self.desk.run(5.0)

    def shown(self, call: int = 7) -> dict[str, Any]:
        rover = self.desk.rover()
        found = rover["last_minute"] if not call else self.desk.shown()["incident"]
        assert isinstance(found, dict)
        return found

    def short(self) -> dict[str, Any]:
        found = self.shown()["files"]
        assert found, self.shown()
        (one,) = (file for file in found if file["name"] == NAME)
        return dict(one)

    def requests(self) -> list[Answer]:
        return [one for one in self.desk.requests() if isinstance(one.operations[0], PackIncident)]

    def reply(self, result: Result, text: str) -> None:
        request = self.requests()[-1]
        ack = Acknowledgement.without_figures(request.transaction, 0, result, text)
        self.desk.link.link.answers.acknowledge(request, ack, self.desk.link.now)

    def pack(self) -> None:
        """Ask for an incident of call 7; it is packed."""
        self.desk.post("incident", call=7)
        self.desk.run(1.0)
        self.told = Incidents(7)
        self.reply(Result.APPLIED, "C7 is being packed")
        self.desk.until(lambda: self.shown()["text"] == "It is being packed.")
        self.told = Incidents(packed=(PACKED,))
        self.desk.until(lambda: bool(self.shown()["files"]))

    def fetch(self, seconds: float = 100.0) -> None:
        self.desk.post("fetch", name=NAME)
        self.desk.until(lambda: "url" in self.short(), seconds)

    def stored(self) -> list[bytes]:
        return [path.read_bytes() for path in sorted(self.folder.iterdir())]


@pytest.fixture
def rover(thing_call: CallReport, quiet_summary: Summary, tmp_path: Path) -> Iterator[Rover]:
    made = Rover(thing_call, quiet_summary, tmp_path)
    yield made
    json.dumps(made.desk.console.documents(made.desk.link.now))


def test_a_request_is_delivered_as_an_answer_is_and_its_progress_is_told(rover: Rover) -> None:
    assert rover.shown() == {"text": "", "busy": False, "packing": False, "files": []}
    assert rover.desk.post("incident", call=7) == "asked for"
    assert rover.shown()["busy"]
    rover.desk.run(1.0)
    (request,) = rover.requests()
    assert (request.target, request.motion, request.operations) == (0, Motion.NONE, (PackIncident(7),))
    rover.told = Incidents(7)
    rover.reply(Result.APPLIED, "C7 is being packed")
    rover.desk.until(lambda: rover.shown()["text"] == "It is being packed.")
    rover.told = Incidents(packed=(PACKED._replace(note="without a recording: switched off"),))
    rover.desk.until(lambda: bool(rover.shown()["files"]))
    assert rover.shown()["text"] == "It is without a recording: switched off."
    assert not rover.shown()["busy"]
    short, whole = rover.shown()["files"]
    assert (short["bytes"], short["fetchable"], whole["fetchable"]) == (len(CONTENT), True, False)
    assert "too much for MAVLink FTP" in whole["problem"]
    assert whole["bytes"] > MAX_BYTES
    assert rover.shown(0)["files"] == [], "not of the last minute"


@pytest.mark.slow
def test_a_request_is_followed_for_as_long_as_the_rover_packs(rover: Rover) -> None:
    rover.desk.post("incident", call=7)
    rover.desk.run(1.0)
    rover.told = Incidents(7)
    rover.reply(Result.APPLIED, "C7 is being packed")
    rover.desk.run(FOLLOWED_S + 20.0)
    assert rover.shown()["busy"]
    rover.told = Incidents(packed=(PACKED,))
    rover.desk.until(lambda: bool(rover.shown()["files"]))


def test_packing_that_somebody_else_asked_for_is_followed_to_its_end(
    rover: Rover, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(incidents, "QUICK_FOR_LARGE", 0.0)
    rover.told = Incidents(7)
    rover.desk.until(lambda: rover.shown()["text"] == "It is being packed.")
    rover.told = Incidents(packed=(PACKED,))
    rover.desk.until(lambda: bool(rover.shown()["files"]))


def test_packing_is_cancelled_by_an_answer_that_belongs_to_no_call(rover: Rover) -> None:
    rover.desk.post("incident", call=7)
    rover.desk.run(1.0)
    rover.told = Incidents(7)
    rover.reply(Result.APPLIED, "C7 is being packed")
    rover.desk.until(lambda: bool(rover.shown()["packing"]))
    rover.desk.post("answer", call=None, motion="none", changes=[{"cancel_incident": 7}])
    rover.desk.until(lambda: rover.desk.requests()[-1].operations == (CancelIncident(7),))
    assert (rover.desk.requests()[-1].target, rover.desk.requests()[-1].motion) == (0, Motion.NONE)
    rover.told = Incidents(failed=(7, "it was cancelled"))
    rover.desk.until(lambda: rover.shown()["text"] == "It could not be packed: it was cancelled.")
    assert not rover.shown()["busy"]


@pytest.mark.parametrize(
    ("result", "text"),
    [(Result.REFUSED, "C3 is being packed"), (Result.DENIED, "this sender may not answer")],
)
def test_a_refused_request_says_why(rover: Rover, result: Result, text: str) -> None:
    rover.desk.post("incident", call=None)
    rover.desk.run(1.0)
    assert rover.requests()[-1].operations == (PackIncident(0),)
    rover.reply(result, text)
    rover.desk.run(1.0)
    assert text in rover.shown(0)["text"]
    assert not rover.shown(0)["busy"]


def test_an_incident_that_could_not_be_packed_says_why(rover: Rover) -> None:
    rover.desk.post("incident", call=7)
    rover.desk.run(1.0)
    rover.told = Incidents(failed=(7, "the disk is full: 200 MiB stay free"))
    rover.reply(Result.APPLIED, "C7 is being packed")
    rover.desk.until(lambda: "sent" not in rover.shown()["text"])
    rover.desk.run(5.0)
    assert rover.shown()["text"] == "It could not be packed: the disk is full: 200 MiB stay free."


def test_a_request_that_no_rover_acknowledges_is_lost_and_can_be_repeated(rover: Rover) -> None:
    rover.desk.hears = False
    rover.desk.post("incident", call=7)
    rover.desk.run(70.0)
    assert "LOST" in rover.shown()["text"]
    assert not rover.shown()["busy"]


def test_a_go_does_not_wait_for_a_request_that_is_not_acknowledged(rover: Rover) -> None:
    rover.desk.post("incident", call=7)
    rover.desk.post("answer", call=7, motion="go", changes=[])
    rover.desk.run(0.5)
    assert [one.motion for one in rover.desk.requests()] == [Motion.NONE, Motion.GO]


def test_a_file_is_fetched_verified_stored_and_offered(rover: Rover) -> None:
    rover.pack()
    assert rover.short()["seconds"] > 1.0
    assert rover.short()["received"] == 0
    rover.fetch()
    assert rover.stored() == [CONTENT]
    assert rover.short()["url"] == f"/incidents/1/{NAME}"
    path = rover.desk.console.incident(1, NAME)
    assert path is not None
    assert path.name.startswith("rover1-")
    assert path.name.endswith(NAME)
    assert rover.desk.console.incident(1, "0003-C7.zip") is None
    assert rover.desk.console.incident(2, NAME) is None


def test_a_call_and_an_answer_come_first_and_the_file_goes_on_where_it_was(rover: Rover) -> None:
    rover.pack()
    rover.desk.post("fetch", name=NAME)
    rover.desk.until(lambda: 5_000 < rover.short()["received"] < 20_000)
    before, opened = rover.short()["received"], rover.desk.link.now
    rover.desk.post("answer", call=7, motion="go", changes=[])
    rover.desk.run(1.0)
    assert rover.desk.requests()[-1].motion is Motion.GO
    rover.desk.acknowledge(Result.APPLIED, Stage.CLOSED, "go on")
    rover.desk.run(1.0)
    assert rover.desk.shown()["answers"][-1]["tone"] == "good", "within 2 s"
    rover.desk.post("fetch", what="check")
    rover.desk.run(2.0)
    assert rover.short()["received"] >= before, "it was interrupted for the check, and lost nothing"
    rover.desk.until(lambda: "url" in rover.short(), 100.0)
    assert rover.stored() == [CONTENT]
    assert rover.desk.link.now - opened < 60.0


def test_it_can_be_stopped_and_gone_on_with(rover: Rover) -> None:
    rover.pack()
    rover.desk.post("fetch", name=NAME)
    rover.desk.until(lambda: rover.short()["received"] > 8_000)
    assert rover.desk.post("stop", name=NAME) == "stopped"
    received = rover.short()["received"]
    rover.desk.run(10.0)
    assert (rover.short()["waits"], rover.short()["received"]) == (False, received)
    began = rover.desk.link.now
    rover.fetch()
    assert rover.stored() == [CONTENT]
    whole = len(CONTENT) / (received / 8.0)
    assert rover.desk.link.now - began < whole * 8.0


@pytest.mark.slow
def test_a_link_that_is_cut_in_the_middle_costs_what_was_not_here_yet(rover: Rover) -> None:
    rover.pack()
    rover.desk.post("fetch", name=NAME)
    rover.desk.until(lambda: rover.short()["received"] > 8_000)
    rover.desk.hears = False
    rover.desk.run(LIFETIME_S + 30.0)
    received = rover.short()["received"]
    assert received > 8_000
    rover.desk.hears = True
    rover.desk.until(lambda: "url" in rover.short(), 200.0)
    assert rover.stored() == [CONTENT]


def test_a_damaged_file_is_not_stored_and_is_fetched_anew(rover: Rover) -> None:
    damaged = bytearray(CONTENT)
    damaged[5_000] ^= 1
    rover.content = bytes(damaged)
    rover.pack()
    rover.desk.post("fetch", name=NAME)
    rover.desk.until(lambda: rover.short()["problem"] == "it came damaged", 100.0)
    assert rover.short()["received"] == 0
    rover.content = CONTENT
    rover.desk.until(lambda: "url" in rover.short(), 100.0)
    assert rover.stored() == [CONTENT]


def test_while_a_file_is_checked_answers_leave(rover: Rover, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, may_end = threading.Event(), threading.Event()

    def check(_: bytes) -> bool:
        begun.set()
        return may_end.wait(5.0)

    monkeypatch.setattr(incidents, "_is_whole", check)
    rover.pack()
    rover.desk.post("fetch", name=NAME)
    rover.desk.until(begun.is_set, 100.0)
    assert (rover.short()["waits"], rover.short()["received"]) == (True, len(CONTENT))
    rover.desk.post("answer", call=7, motion="go", changes=[])
    rover.desk.run(1.0)
    assert rover.desk.requests()[-1].motion is Motion.GO
    may_end.set()
    rover.desk.until(lambda: "url" in rover.short())


def members(count: int) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for number in range(count):
            archive.writestr(f"{number:05d}", b"")
    return packed.getvalue()


def with_end(content: bytes, members: int, after: bytes = b"") -> bytes:
    """The zip with another count of members in its end, and a comment after it."""
    end = list(struct.unpack("<4s4H2LH", content[-22:]))
    end[3:5] = members, members
    end[7] = len(after)
    return content[:-22] + struct.pack("<4s4H2LH", *end) + after


MANY = members(2000)


@pytest.mark.parametrize(
    "content",
    [MANY, with_end(MANY, 1), with_end(MANY, 1, b"a comment"), b"PK\5\6", b""],
    ids=["many", "a count too small", "a comment", "torn", "empty"],
)
def test_a_directory_that_would_take_long_to_read_is_not_read(
    content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = list[Any]()
    monkeypatch.setattr(zipfile, "ZipFile", opened.append)
    assert not incidents._is_whole(content)
    assert opened == []


def test_a_zip_of_as_many_files_as_a_rover_packs_is_whole_and_one_of_more_is_not() -> None:
    assert incidents._is_whole(members(MOST_MEMBERS))
    assert not incidents._is_whole(members(MOST_MEMBERS + 1))
    assert not incidents._is_whole(with_end(members(MOST_MEMBERS + 1), 1))


def test_a_disk_that_takes_no_file_is_said(rover: Rover) -> None:
    rover.folder.write_text("no folder")
    rover.pack()
    rover.desk.post("fetch", name=NAME)
    rover.desk.until(lambda: "it cannot be stored: " in rover.short()["problem"], 100.0)


def test_the_newest_files_stay_in_the_folder_and_what_is_none_of_ours(rover: Rover) -> None:
    rover.folder.mkdir()
    (rover.folder / "notes.zip").write_text("of the operator")
    for number in range(MOST_STORED + 3):
        (rover.folder / f"rover1-20260101-0000{number:02d}-0001-C1.zip").write_text("old")
    rover.pack()
    rover.fetch()
    assert len(list(rover.folder.iterdir())) == MOST_STORED + 1
    assert (rover.folder / "notes.zip").exists()
    assert CONTENT in rover.stored()


@pytest.mark.slow
def test_where_the_rovers_page_is_named_files_come_from_it(
    thing_call: CallReport, quiet_summary: Summary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "state" / "incidents").mkdir(parents=True)
    (tmp_path / "state" / "incidents" / NAME).write_bytes(CONTENT)
    stage = PageStage(tmp_path / "state", token=TOKEN)
    own = {"authorization": f"Bearer {TOKEN}"}
    stage.until(lambda: stage.up() and stage.get("/healthz", "GET", own).status == 200)
    pages = read_pages([f"1={stage.page.url}"], TOKEN)
    rover = Rover(thing_call, quiet_summary, tmp_path, pages)
    rover.pack()
    _, whole = rover.shown()["files"]
    assert whole["fetchable"], "larger than MAVLink FTP takes"
    rover.desk.post("fetch", name=NAME)
    arrives(rover)
    assert rover.stored() == [CONTENT]
    rover.desk.post("fetch", name=whole["name"])
    arrives(rover, whole["name"])
    _, whole = rover.shown()["files"]
    assert whole["problem"] == "the rover's page refuses it: status 404"
    with monkeypatch.context() as ending:
        checking = ThreadPoolExecutor(1)
        ending.setattr(incidents, "_CHECKING", checking)
        checking.shutdown()  # as when the console ends
        rover.desk.post("fetch", name=NAME)
        arrives(rover)
    assert rover.stored() == [CONTENT]
    stage.close()
    rover.desk.post("fetch", name=whole["name"])
    arrives(rover, whole["name"])
    assert "the rover's page does not answer" in rover.shown()["files"][1]["problem"]


def arrives(rover: Rover, name: str = NAME) -> None:
    """Wait until a download has ended."""

    def arrived() -> bool:
        rover.desk.run(0.05)
        return name not in rover.desk.console.desks[1].incidents._downloads

    wait_for(arrived, 20.0)


@pytest.mark.parametrize(
    "given", ["1=ftp://rover", "rover", "0=http://rover", "1=http://", "\u0661=http://r"]
)
def test_a_page_that_cannot_be_is_refused(given: str) -> None:
    with pytest.raises(ValueError, match="write it as 1=http://rover:8191"):
        read_pages([given], TOKEN)
    with pytest.raises(ValueError, match="needs --page-token-file"):
        read_pages(["1=http://rover"], "")


@pytest.mark.parametrize(
    "name",
    ["../../etc/passwd", "0003-C7.zip/..", "/0003-C7.zip", "0003-C7", ".0003-C7.zip", "", None, 7, "x" * 999],
)
def test_only_names_of_incident_files_are_fetched(name: Any) -> None:
    for kind in ("fetch", "stop"):
        with pytest.raises(RequestError):
            read_request(kind, json.dumps({"rover": 1, "name": name}).encode())
    with pytest.raises(RequestError):
        read_request("incident", b'{"rover": 1, "call": 70000}')
    assert read_request("stop", b'{"rover": 1, "name": "0003-last.zip"}') == (
        1,
        IncidentFileRequest("0003-last.zip", stop=True),
    )
    assert read_request("incident", b'{"rover": 1}') == (1, IncidentRequest(0))
