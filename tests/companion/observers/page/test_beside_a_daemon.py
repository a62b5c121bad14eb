"""A whole companion with its page: whatever happens to the page, the companion judges on."""

from __future__ import annotations

import json
import os
import signal
import socket
from collections.abc import Iterator, Mapping
from contextlib import closing
from typing import Any
from urllib.parse import urlsplit

import pytest

from companion.observers.page.page import missing
from companion.wire.ids import PAGE_SENDER
from tests.companion.observers.page.played import TOKEN, Browser
from tests.companion.processes import Companion
from tests.waiting import is_gone, wait_for

pytestmark = pytest.mark.skipif(bool(missing()), reason="the extra web is not installed")
PAGE = "companion.observers.page"


class WithPage(Companion, Browser):
    """`companion run`, and what its page answers to somebody who has the token."""

    headers: Mapping[str, str] = {"authorization": f"Bearer {TOKEN}"}

    @property
    def url(self) -> str:
        return str(self.told().get("web", {}).get("url", ""))


@pytest.fixture(scope="module")
def companion(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WithPage]:
    web = f'listen = "127.0.0.1:0"\ntoken = "{TOKEN}"'
    with closing(WithPage(tmp_path_factory.mktemp("rover"), web=web)) as running:
        yield running


def test_a_call_is_answered_on_the_page_and_the_answer_stands_in_its_record(companion: WithPage) -> None:
    companion.until(lambda: json.loads(companion.get("/state.json").body or b"{}").get("open"))
    opened = json.loads(companion.get("/state.json").body)["open"]
    box = opened["worst_tile_box"]
    tap = {"tap": "drum", "weight": -1, "box": box, "frame": opened["frame_id"]}
    said = companion.post("/answer", {"call": opened["id"], "motion": "go", "changes": [tap]})
    assert (said.status, json.loads(said.body)) == (200, {"done": "sent"})

    def answers() -> list[dict[str, Any]]:
        records = json.loads(companion.get("/calls.json").body or b"[]")
        return next((one["answers"] for one in records if one["id"] == opened["id"]), [])

    companion.until(answers)
    (given,) = answers()
    assert given["sender"] == list(PAGE_SENDER)
    assert given["motion"] == "go"
    assert given["operations"][0].startswith("tap drum: -1 ")
    companion.until(lambda: "drum" in json.loads(companion.get("/state.json").body)["words"])
    (shown,) = (
        one
        for one in json.loads(companion.get("/shown-calls.json").body)["calls"]
        if one["id"] == opened["id"]
    )
    assert (len(shown["answers"]), shown["said"], shown["undo"]) == (1, [], {}), "it stands there once"
    assert companion.post("/undo", {"call": opened["id"] + 1}).status == 409


def test_it_shows_its_settings_and_that_they_are_changed_in_the_shell_where_no_service_runs_it(
    companion: WithPage,
) -> None:
    companion.until(lambda: companion.get("/settings.json").status == 200)
    told = json.loads(companion.get("/settings.json").body)
    rows = {row["key"]: row for row in told["rows"]}
    assert (rows["perceiver.name"]["value"], rows["web.token"]["value"]) == ("painted", None)
    assert told["file"].endswith("/companion.toml")
    assert "not started by its service" in told["problem"]
    said = companion.post("/settings/look", {"changes": {"call.votes": 3}})
    assert "not started by its service" in json.loads(said.body)["problem"]


def test_it_judges_on_while_its_page_is_killed_and_the_page_returns(companion: WithPage) -> None:
    companion.until(lambda: companion.get("/healthz").status == 200)
    state = json.loads(companion.get("/state.json").body)
    assert state["words"]["grass"] == 1.0
    host = urlsplit(companion.told()["web"]["url"])
    with socket.create_connection((str(host.hostname), int(host.port or 0)), timeout=5.0) as watching:
        watching.sendall(
            f"GET /events HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {TOKEN}\r\n\r\n".encode()
        )
        companion.until(lambda: companion.get("/live.jpg").body.startswith(b"\xff\xd8\xff"))
    companion.until(lambda: json.loads(companion.get("/calls.json").body or b"[]"))
    frames, first = companion.told()["frames"], companion.child(PAGE)
    os.kill(first, signal.SIGKILL)
    companion.until(lambda: companion.child(PAGE) not in (0, first))
    companion.until(lambda: companion.get("/healthz").status == 200)
    companion.until(lambda: companion.told()["web"]["restarts"] == 1)
    said = companion.told()
    assert said["frames"] > frames
    assert said["vision"] == {"trouble": "", "restarts": 0}
    last = companion.child(PAGE)
    companion.process.send_signal(signal.SIGKILL)
    companion.process.wait()
    wait_for(lambda: is_gone(last), 1.0, lambda: "it ends with the supervisor")
