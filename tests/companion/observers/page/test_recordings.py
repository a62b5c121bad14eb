"""Recordings on the rover's page: listed, shown moment by moment, saved, packed and deleted."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest

pytest.importorskip("mcap")

from companion.observers.page import recordings
from companion.observers.page.page import missing
from companion.observers.page.recordings import RecordingsFolder
from companion.observers.recording.contents import as_json, image
from companion.observers.recording.mcap_file import McapFile
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.topics import Topic
from companion.wire.answers import Acknowledgement, Answer, RecordingWish, Wish
from companion.wire.ids import Motion, Result
from companion.wire.incidents import Incidents, Packed
from tests.companion.observers.page.played import JPEG, TOKEN, Stage
from tests.companion.observers.recording.made import BEGAN, NS, opened, words

pytestmark = pytest.mark.skipif(bool(missing()), reason="the extra web is not installed")
NAMES = ["99", "-1", "1e3", "..", "..%2f..%2fstatus", "%2e%2e", "0x1", "\u0663", "", "1" * 10]
PATHS = ["/recordings/{}.mcap", "/recordings/{}/moment.json", "/recordings/{}/frame.jpg"]
WITH_TOKEN = {"authorization": f"Bearer {TOKEN}"}


def recorded(path: Path, seconds: int = 6, call: int = 0, picture: bytes = JPEG) -> McapFile:
    """Write a recording with a frame a second, and leave it open."""
    path.parent.mkdir(exist_ok=True)
    file = McapFile(path, 1 << 22)
    file.add(words(1.0))
    for second in range(seconds):
        at = BEGAN + second * NS
        file.add(RecordedMessage(Topic.CAMERA, at, image(picture, "jpeg", at), second + 1))
        file.add(RecordedMessage(Topic.STATE, at, as_json({"state": "ok", "open": None})))
        if second == 2 and call:
            file.add(opened(call, second))
        file.flush()
    return file


class Recorded:
    """A page with a token over seven recordings, and what it hands over."""

    def __init__(self, folder: Path) -> None:
        home = folder / "recordings"
        for number in (1, 3):
            recorded(home / f"00000{number}.mcap").finish()
        recorded(home / "000002-event.mcap", call=7).finish()
        torn = recorded(home / "000004.mcap")
        torn.sync()
        (home / "000005.mcap").write_bytes(b"rubbish " * 500)
        (home / "000006.mcap").write_bytes((home / "000001.mcap").read_bytes()[:700])
        self.writing = recorded(home / "000007.mcap", 4)
        (home / "notes.txt").write_bytes(b"of the owner")
        (folder / "status.json").write_bytes(b"{}")
        os.symlink(folder / "status.json", home / "000008.mcap")
        self.home = home
        self.given: list[Answer] = []
        self.stage = Stage(folder, token=TOKEN)
        self.stage.page.answer = lambda payload, _at: self.given.append(Answer.unpack(payload)[0])
        self.stage.news["status"]["recording"] = {"on": True, "files": 7}
        self.stage.until(lambda: self.stage.up() and self.get("/healthz")[0] == 200)

    def get(self, path: str, method: str = "GET") -> tuple[int, Any, bytes]:
        return self.stage.get(path, method, WITH_TOKEN)

    def told(self, path: str) -> Any:
        status, _, body = self.get(path)
        assert status == 200, body
        return json.loads(body)

    def wakes(self) -> None:
        """Tell the page news, without which it passes nothing on."""
        self.given.clear()
        self.stage.until(lambda: self.get("/healthz")[0] == 200)

    def rows(self) -> dict[int, dict[str, Any]]:
        return {row["number"]: row for row in self.told("/recordings.json")["recordings"]}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recorded]:
    made = Recorded(tmp_path_factory.mktemp("state"))
    yield made
    made.stage.close()
    made.writing.finish()


def test_the_newest_stands_first_and_each_says_what_it_is(page: Recorded) -> None:
    told = page.told("/recordings.json")
    assert [row["number"] for row in told["recordings"]] == [7, 6, 5, 4, 3, 2, 1]
    assert (told["files"], told["older"]) == (7, False)
    rows = page.rows()
    assert (rows[2]["seconds"], rows[2]["frames"], rows[2]["begin"]) == (5.0, 6, BEGAN / NS)
    assert rows[2]["events"] == [{"at": 2000, "what": "call opened", "id": 7}]
    assert [number for number, row in rows.items() if row["writing"]] == [7]
    assert rows[7]["frames"] == 4
    assert rows[7]["trouble"] == rows[3]["trouble"] == ""
    assert rows[4]["trouble"] == "it was cut off: what is whole in it is shown"
    assert rows[5]["trouble"] == "nothing in it can be read"
    assert rows[4]["frames"] == 6


def test_a_moment_and_its_picture_are_shown_of_finished_torn_and_growing_ones(page: Recorded) -> None:
    for number in (2, 4, 7):
        found = page.told(f"/recordings/{number}/moment.json?at=2500")
        assert (found["at"], found["previous"], found["next"], found["state"]) == (2000, 1000, 3000, "ok")
        assert found["words"] == {"grass": 1.0}
        status, headers, body = page.get(f"/recordings/{number}/frame.jpg?at=2500")
        assert (status, headers["content-type"], body) == (200, "image/jpeg", JPEG)


def test_of_rubbish_nothing_is_shown_and_it_can_be_saved(page: Recorded) -> None:
    assert page.get("/recordings/5/moment.json?at=0")[0] == 404
    assert page.get("/recordings/5/frame.jpg")[0] == 404
    status, headers, body = page.get("/recordings/5.mcap")
    assert (status, body) == (200, b"rubbish " * 500)
    assert headers["content-disposition"] == 'attachment; filename="000005.mcap"'


def test_a_file_is_saved_whole_under_its_own_name(page: Recorded) -> None:
    content = (page.home / "000002-event.mcap").read_bytes()
    status, headers, body = page.get("/recordings/2.mcap")
    assert (status, headers["content-length"], body) == (200, str(len(content)), content)
    assert headers["content-disposition"] == 'attachment; filename="000002-event.mcap"'
    assert page.get("/recordings/2.mcap", "HEAD")[2] == b""


@pytest.mark.parametrize("number", NAMES)
@pytest.mark.parametrize("path", PATHS)
def test_no_other_file_is_opened(page: Recorded, path: str, number: str) -> None:
    assert page.get(path.format(quote(number, safe="%")))[0] == 404


@pytest.mark.parametrize("at", ["-1", "1.5", "nan", "9" * 13, "", "0;1"])
def test_no_other_moment_is_looked_for(page: Recorded, at: str) -> None:
    assert page.get(f"/recordings/1/moment.json?at={at}")[0] == 404


def test_a_link_in_the_folder_is_neither_listed_nor_followed(page: Recorded) -> None:
    assert 8 not in page.rows()
    assert page.get("/recordings/8.mcap")[0] == 503
    assert page.get("/recordings/8/moment.json")[0] == 503


def test_older_ones_are_listed_when_they_are_asked_for(
    page: Recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recordings, "PAGE", 2)
    folder = RecordingsFolder(str(page.home.parent))
    first = folder.shown(999_999_999, on=False)
    assert ([row["number"] for row in first["recordings"]], first["older"]) == ([7, 6], True)
    last = folder.shown(1, on=False)
    assert ([row["number"] for row in last["recordings"]], last["older"]) == ([1], False)
    assert RecordingsFolder(str(tmp_path)).shown(9, on=True)["recordings"] == []


def test_what_takes_too_long_is_left_for_the_next_time(page: Recorded) -> None:
    clock = count(0.0, 0.3)
    folder = RecordingsFolder(str(page.home.parent), lambda: next(clock))
    first, second = (
        [row.get("unread", False) for row in folder.shown(3, on=False)["recordings"]] for _ in range(2)
    )
    assert first.count(True) > second.count(True)
    hurried = count(0.0, 0.6)
    folder = RecordingsFolder(str(page.home.parent), lambda: next(hurried))
    (row,) = (one for one in folder.shown(4, on=False)["recordings"] if one["number"] == 4)
    assert row["unread"]
    (row,) = (one for one in folder.shown(4, on=False)["recordings"] if one["number"] == 4)
    assert "takes too long" in row["trouble"], "it is left alone for a minute"
    with pytest.raises(TimeoutError):
        RecordingsFolder(str(page.home.parent), iter(range(0, 99, 4)).__next__).moment(4, 0)


def test_a_deletion_goes_the_way_of_an_answer_and_what_became_of_it_is_shown(page: Recorded) -> None:
    page.wakes()
    asked = page.stage.post("/recording", {"number": 7, "wish": "delete"})
    assert (asked.status, json.loads(asked.body)) == (200, {"done": "asked for"})
    page.stage.until(lambda: bool(page.given))
    (request, *_) = page.given
    assert (request.motion, request.operations) == (Motion.NONE, (RecordingWish(7, Wish.DELETE),))
    assert page.rows()[7]["deletion"] == "It is being deleted."
    page.stage.page.acknowledge(
        Acknowledgement.without_figures(request.transaction, 0, Result.REFUSED, "it is being written")
    )
    page.stage.until(lambda: "it is being written" in page.rows()[7]["deletion"])
    assert (page.home / "000007.mcap").exists(), "the page itself deletes nothing"


def test_one_is_packed_and_the_file_is_offered(page: Recorded) -> None:
    page.wakes()
    assert page.stage.post("/recording", {"number": 2, "wish": "pack"}).status == 200
    page.stage.until(lambda: bool(page.given))
    assert page.given[0].operations == (RecordingWish(2, Wish.PACK),)
    page.stage.page.acknowledge(
        Acknowledgement.without_figures(page.given[0].transaction, 0, Result.APPLIED, "it is being packed")
    )
    page.stage.news["incidents"] = Incidents(packed=(Packed(3, -2, 5_000_000, 80_000),)).document()
    page.stage.until(lambda: bool(page.rows()[2]["incident"]["files"]))
    assert [one["url"] for one in page.rows()[2]["incident"]["files"]] == [
        "/incidents/0003-R2-short.zip",
        "/incidents/0003-R2.zip",
    ]
    assert page.rows()[3]["incident"]["files"] == []


@pytest.mark.parametrize(
    "body",
    [{"number": 0, "wish": "delete"}, {"number": "2", "wish": "delete"}, {"number": 2}, {"wish": "pack"}, []]
    + [{"number": 2, "wish": wish} for wish in ("DELETE", 2, None, ["delete"])],
)
def test_rubbish_is_refused_and_asks_for_nothing(page: Recorded, body: Any) -> None:
    page.given.clear()
    assert page.stage.post("/recording", body).status == 409
    page.stage.turn()
    assert not page.given


def test_without_the_token_nothing_is_seen_and_without_one_nothing_is_saved_or_deleted(
    page: Recorded, tmp_path: Path
) -> None:
    assert page.stage.get("/recordings.json").status == 401
    assert page.stage.get("/recordings/2.mcap").status == 401
    recorded(tmp_path / "recordings" / "000001.mcap").finish()
    stage = Stage(tmp_path)
    stage.ready()
    (row,) = json.loads(stage.get("/recordings.json").body)["recordings"]
    assert "incident" not in row
    assert stage.get("/recordings/1/frame.jpg?at=0").body == JPEG
    assert stage.get("/recordings/1.mcap").status == 404
    assert stage.post("/recording", {"number": 1, "wish": "delete"}).status == 405
    stage.close()
