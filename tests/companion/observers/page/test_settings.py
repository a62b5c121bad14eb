"""Who has the page's token changes open settings of the file; guarded ones and rubbish get nowhere."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from companion.config import Config
from companion.config.rows import all_settings
from companion.observers.page.messages import SETTINGS_REQUEST
from companion.observers.page.page import missing
from companion.observers.page.settings import PageSettings
from companion.pages.requests import RequestError
from companion.system.datagrams import Datagram
from tests.companion.observers.page.played import TOKEN, Answer, Stage
from tests.companion.observers.page.played_settings import FILE, SettingsStage

pytestmark = pytest.mark.skipif(bool(missing()), reason="the extra web is not installed")


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SettingsStage]:
    with closing(SettingsStage(tmp_path_factory.mktemp("state"), token=TOKEN)) as stage:
        stage.headers = {"authorization": f"Bearer {TOKEN}"}
        stage.ready()
        yield stage


def post(stage: Stage, path: str, content: Any) -> tuple[int, Mapping[str, Any]]:
    """Post while the supervisor turns."""
    found = list[Answer]()
    asking = threading.Thread(target=lambda: found.append(stage.post(path, content)))
    asking.start()
    stage.until(lambda: found)
    asking.join()
    return found[0].status, json.loads(found[0].body)


@pytest.mark.slow
def test_a_change_is_looked_at_refused_while_armed_and_written_when_the_vehicle_stands(
    stage: SettingsStage,
) -> None:
    told = stage.get("/settings.json").body
    assert b"s3cr3tword" not in told
    assert TOKEN.encode() not in told
    status, looked = post(stage, "/settings/look", {"changes": {"call.votes": 3}})
    assert (status, looked["problem"]) == (200, "")
    assert "+votes = 3" in looked["diff"]
    assert "s3cr3tword" not in looked["diff"]
    stage.armed = True
    assert "disarm" in post(stage, "/settings/write", {"proposal": looked["proposal"]})[1]["problem"]
    stage.armed = False
    assert stage.file.read_text() == FILE
    assert post(stage, "/settings/write", {"proposal": looked["proposal"]})[1]["written"] is True
    assert "votes = 3" in stage.file.read_text()
    assert stage.page.restarted == 0


@pytest.mark.parametrize("key", ["web.token", "link.signing_key", "stopping.unchecked", "words.grass", "a"])
def test_the_page_itself_refuses_what_is_for_the_shell_or_no_setting(stage: SettingsStage, key: str) -> None:
    status, told = post(stage, "/settings/look", {"changes": {key: "x"}})
    assert (status, "shell" in told["problem"] or "no setting" in told["problem"]) == (409, True)


def test_the_supervisor_refuses_a_value_that_the_page_lets_pass(stage: SettingsStage) -> None:
    for change in ({"camera.source": "pipe:true"}, {"call.policy": "hold"}, {"link.url": "udpin:0.0.0.0:1"}):
        status, told = post(stage, "/settings/look", {"changes": change})
        assert status == 200
        assert "only in the shell" in told["problem"]


@pytest.mark.parametrize("content", [{}, {"changes": []}, {"changes": {}}, {"changes": "x"}, [], 7, None])
def test_rubbish_is_refused_by_the_page(stage: SettingsStage, content: Any) -> None:
    assert stage.post("/settings/look", content).status == 409
    assert stage.post("/settings/write", content).status == 409


def test_nothing_is_shown_or_taken_without_a_token(tmp_path: Path) -> None:
    with closing(SettingsStage(tmp_path)) as stage:
        stage.ready()
        assert stage.get("/settings.json").status == 404
        assert stage.post("/settings/look", {"changes": {"call.votes": 3}}).status == 405
        said = Datagram(SETTINGS_REQUEST, {"id": "a", "asked_from": "x", "changes": {"call.votes": 3}})
        assert not stage.page._take(said.encoded(), 1.0), "not from its process, either"


def test_a_process_that_asks_rubbish_is_taken_for_broken(stage: SettingsStage) -> None:
    for content in ({}, {"id": "a"}, {"id": "a", "asked_from": "x", "changes": {"a": {"b": {}}}}):
        assert not stage.page._take(Datagram(SETTINGS_REQUEST, content).encoded(), 1.0)


def test_one_request_waits_at_a_time_not_for_ever_and_a_late_answer_is_let_go() -> None:
    async def asked() -> None:
        sent = list[Mapping[str, Any]]()
        settings = PageSettings(sent.append, within=0.05)
        settings.told = {"rows": all_settings(Config(), {})}
        body = b'{"changes": {"call.votes": 3}}'
        first = asyncio.create_task(settings._look(body, "10.0.0.7"))
        await asyncio.sleep(0)
        with pytest.raises(RequestError, match="another change"):
            await settings._look(body, "10.0.0.7")
        with pytest.raises(RequestError, match="did not answer"):
            await first
        settings.answered({"id": sent[0]["id"], "proposal": "late"})
        second = asyncio.create_task(settings._look(body, "10.0.0.7"))
        await asyncio.sleep(0)
        settings.answered({"id": sent[0]["id"], "proposal": "late"})
        settings.answered({"id": sent[1]["id"], "proposal": "new"})
        assert (await second)["proposal"] == "new"

    asyncio.run(asked())


def test_where_there_is_no_helper_that_is_told(tmp_path: Path) -> None:
    with closing(SettingsStage(tmp_path, helper=False, token=TOKEN)) as stage:
        stage.headers = {"authorization": f"Bearer {TOKEN}"}
        stage.ready()
        assert "not started by its service" in json.loads(stage.get("/settings.json").body)["problem"]
        told = post(stage, "/settings/look", {"changes": {"call.votes": 3}})[1]
        assert "not started by its service" in told["problem"]
