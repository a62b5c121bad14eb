"""Incident files on the rover's page: asked for and saved by whoever has the token, and by nobody else."""

from __future__ import annotations

import json
import os
import random
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.observers.page.disk import MOST_DOWNLOADS
from companion.observers.page.page import missing
from companion.wire.answers import Acknowledgement, Answer, CancelIncident, PackIncident
from companion.wire.ids import Motion, Result
from companion.wire.incidents import Incidents, Packed
from tests.companion.observers.page.played import TOKEN, Stage
from tests.waiting import wait_for

pytestmark = pytest.mark.skipif(bool(missing()), reason="the extra web is not installed")
CONTENT = random.Random(1).randbytes(3_000_000)
PACKED = Packed(12, 7, len(CONTENT), 90_000, "without a recording: nothing was recorded then")
FILE = "/incidents/0012-C7.zip"
WITH_TOKEN = {"authorization": f"Bearer {TOKEN}"}


class Page:
    """A page with a token; what it hands over is in `given`."""

    def __init__(self, folder: Path) -> None:
        home = folder / "incidents"
        home.mkdir()
        (home / "0012-C7.zip").write_bytes(CONTENT)
        (home / ".0013-C7.zip").write_bytes(b"half")
        (home / "notes.txt").write_bytes(b"of the owner")
        (folder / "status.json").write_bytes(b"{}")
        os.symlink(folder / "status.json", home / "0014-C7.zip")
        self.given: list[Answer] = []
        self.stage = Stage(folder, token=TOKEN)
        self.stage.page.answer = lambda payload, _at: self.given.append(Answer.unpack(payload)[0])
        self.tell(Incidents())
        self.stage.until(lambda: self.stage.up() and self.get("/healthz")[0] == 200)

    def tell(self, told: Incidents) -> None:
        self.stage.news["incidents"] = told.document()

    def get(self, path: str, method: str = "GET") -> tuple[int, Any, bytes]:
        return self.stage.get(path, method, WITH_TOKEN)

    def shown(self) -> dict[str, Any]:
        found = json.loads(self.get("/shown-calls.json")[2])["last_minute"]
        return dict(found)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    made = Page(tmp_path_factory.mktemp("state"))
    yield made
    made.stage.close()


@pytest.mark.slow
def test_a_request_goes_the_way_of_an_answer_and_its_progress_is_shown(page: Page) -> None:
    assert page.shown() == {"text": "", "busy": False, "packing": False, "files": []}
    asked = page.stage.post("/incident", {"call": None})
    assert (asked.status, json.loads(asked.body)) == (200, {"done": "asked for"})
    page.stage.until(lambda: bool(page.given))
    (request, *_) = page.given
    assert (request.target, request.motion, request.operations) == (0, Motion.NONE, (PackIncident(0),))
    ack = Acknowledgement.without_figures(request.transaction, 0, Result.REFUSED, "C3 is being packed")
    page.stage.page.acknowledge(ack)
    page.stage.until(lambda: "C3 is being packed" in page.shown()["text"])
    page.tell(Incidents(packing=0))
    page.stage.until(lambda: page.shown()["text"] == "It is being packed.")
    page.tell(Incidents(packed=(PACKED._replace(call=0),)))
    page.stage.until(lambda: bool(page.shown()["files"]))
    short, whole = page.shown()["files"]
    assert (short["url"], whole["url"]) == ("/incidents/0012-last-short.zip", "/incidents/0012-last.zip")
    assert page.shown()["text"].endswith("It is without a recording: nothing was recorded then.")


def test_packing_is_cancelled_while_a_call_is_open_too(page: Page) -> None:
    page.tell(Incidents(packing=7))
    page.stage.news["state"]["open"] = {"id": 8, "kind": "call", "stage": "open", "frame_id": 9, "age": 3}
    page.stage.until(lambda: json.loads(page.get("/shown-calls.json")[2])["calls"][:1] != [])
    page.given.clear()
    cancel = {"call": None, "motion": "none", "changes": [{"cancel_incident": 7}]}
    assert page.stage.post("/answer", cancel).status == 200
    page.stage.until(lambda: bool(page.given))
    (request, *_) = page.given
    assert (request.target, request.motion, request.operations) == (0, Motion.NONE, (CancelIncident(7),))
    page.stage.page.acknowledge(
        Acknowledgement.without_figures(request.transaction, 0, Result.APPLIED, "C7 is being cancelled")
    )

    def told() -> tuple[str, str]:
        (newest,) = json.loads(page.get("/shown-calls.json")[2])["alone"]
        return newest["said"], newest["text"]

    page.stage.until(lambda: told() == ("cancel incident 7", "done: C7 is being cancelled"))
    page.stage.news["state"]["open"] = None
    assert page.stage.post("/answer", cancel | {"changes": [{"cancel_incident": -1}]}).status == 409


def test_a_file_is_saved_whole_by_whoever_has_the_token(page: Page) -> None:
    status, headers, body = page.get(FILE)
    assert (status, headers["content-type"], body) == (200, "application/zip", CONTENT)
    assert headers["content-disposition"] == 'attachment; filename="incident-0012-C7.zip"'
    status, headers, body = page.get(FILE, "HEAD")
    assert (status, headers["content-length"], body) == (200, str(len(CONTENT)), b"")
    assert page.stage.get(FILE).status == 401


@pytest.mark.parametrize(
    "name",
    ["0099-C7.zip", ".0013-C7.zip", "notes.txt", "..%2fstatus.json", "../status.json", "0012-C7.zip%00", ""],
)
def test_no_other_file_is_served(page: Page, name: str) -> None:
    assert page.get(f"/incidents/{name}")[0] == 404


def test_a_link_in_the_folder_is_not_followed(page: Page) -> None:
    assert page.get("/incidents/0014-C7.zip")[0] == 503


@pytest.mark.parametrize("body", [{"call": 70000}, {"call": -1}, {"call": "7"}, {"call": True}, [], "C7"])
def test_rubbish_is_refused_and_asks_for_nothing(page: Page, body: Any) -> None:
    page.given.clear()
    assert page.stage.post("/incident", body).status == 409
    page.stage.turn()
    assert not page.given


def test_a_flood_of_requests_is_bounded(page: Page) -> None:
    found = [page.stage.post("/incident", {"call": 1 + number}).status for number in range(12)]
    assert 409 in found, "too many wait already"


def test_of_those_who_fetch_slowly_few_are_served_and_the_page_goes_on(page: Page) -> None:
    request = f"GET {FILE} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {TOKEN}\r\n\r\n".encode()
    slow = []
    for _ in range(MOST_DOWNLOADS):
        one = socket.create_connection(page.stage.address, timeout=5.0)
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        one.sendall(request)
        assert one.recv(100).startswith(b"HTTP/1.1 200")
        slow.append(one)
    wait_for(lambda: page.get(FILE)[0] == 503, 5.0)
    assert page.get("/healthz")[0] == 200
    for one in slow:
        one.close()
    page.stage.until(lambda: page.get(FILE)[0] == 200)


def test_without_a_token_nobody_asks_and_nobody_saves(tmp_path: Path) -> None:
    (tmp_path / "incidents").mkdir()
    (tmp_path / "incidents" / "0012-C7.zip").write_bytes(b"zip")
    stage = Stage(tmp_path)
    stage.ready()
    assert stage.get(FILE).status == 404
    assert stage.post("/incident", {"call": 7}).status == 405
    assert json.loads(stage.get("/shown-calls.json").body)["last_minute"] is None
    stage.close()
