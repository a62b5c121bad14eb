"""`companion rehearse --browser`: answers on the page lead to what the same answers in a file do."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from anytraverse.engine import AnyTraverse
from companion.config import load_config
from companion.desk.drives import rehearsing
from companion.desk.drives.drive import DriveError
from companion.desk.drives.frames import open_drive
from companion.desk.drives.judge import DriveJudge
from companion.desk.drives.rehearsal import Rehearsal
from tests.companion.desk.browsing import Browsing
from tests.companion.desk.drives.filmed import CONFIG
from tests.companion.desk.drives.test_rehearsal import answered, drive, like, rehearsed
from tests.waiting import wait_for

__all__ = ["answered", "drive"]
pytestmark = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("starlette", "uvicorn")), reason="starlette is not installed"
)
ROOT = Path(__file__).parents[4]
PATIENCE = 30.0
COMMAND = (sys.executable, "-m", "companion")


class Person(Browsing):
    """Sees the page of a rehearsal, and posts as it does."""

    def news(self) -> dict[str, Any]:
        """What a page that opens now is told; that it is over where nobody answers any more."""
        try:
            return self._news()
        except OSError:
            return {"state": "over", "calls": []}

    def _news(self) -> dict[str, Any]:
        with self.connected() as connection:
            connection.request("GET", "/events", headers=dict(self.headers))
            response = connection.getresponse()
            while not (line := response.readline()).startswith(b"data:"):
                if not line:
                    raise OSError("the stream ended")
            found: dict[str, Any] = json.loads(line[5:])
            return found

    def until(self, fits: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        def fitting() -> dict[str, Any] | None:
            return news if fits(news := self.news()) else None

        return wait_for(fitting, PATIENCE, self.news, lambda: time.sleep(0.05))

    def call(self, but: int = 0) -> dict[str, Any]:
        """The call that waits for an answer. but: not this one."""

        def waiting(news: dict[str, Any]) -> dict[str, Any] | None:
            found = (one for one in news["calls"] if one["open"] and one["id"] != but)
            return next(found, None) if news["state"] == "asking" else None

        found = waiting(self.until(waiting))
        assert found is not None
        return found


class Running:
    """A rehearsal in a thread of its own, with a page."""

    def __init__(self, drive: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        urls: list[str] = []
        monkeypatch.setattr(webbrowser, "open", urls.append)
        self.out = out
        self.codes: list[int] = []
        config = str(drive.parent / "companion.toml")

        def run() -> None:
            self.codes.append(rehearsing.run(str(drive), file=config, out=str(out), port=0))

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()
        wait_for(lambda: urls, PATIENCE)
        self.person = Person(urls[0])

    def ends(self) -> None:
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


@pytest.fixture
def running(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Running]:
    made = Running(drive, tmp_path / "page", monkeypatch)
    yield made
    if not made.codes:
        made.person.post("/end", {})
        made.ends()


def test_answers_on_the_page_lead_to_what_the_same_answers_in_a_file_do(
    running: Running, drive: Path, tmp_path: Path
) -> None:
    person = running.person
    call = person.call()
    assert list(call["pictures"]) == ["raw", "large"]
    for path in call["pictures"].values():
        assert person.ask(path)[1].startswith(b"\xff\xd8\xff")
    wrong = [{"word": "grass", "weight": 1}, {"word": "meadow", "weight": -1}]
    assert person.post("/answer", {"call": call["id"], "motion": "go", "changes": wrong}) == (
        200,
        {"done": "sent"},
    )
    shown = person.until(lambda news: news["state"] == "asking" and news["calls"][0]["answers"])["calls"][0]
    (refused,) = shown["answers"]
    assert (refused["tone"], refused["text"].startswith("nothing changed: ")) == ("bad", True)
    tap = {"tap": "drum", "weight": -1, "box": [0.40123, 0.5, 0.6, 0.8], "frame": call["frame"]}
    words = [{"word": "dirt path", "weight": 1}, {"word": "tree", "weight": -0.5}, tap]
    assert person.post("/answer", {"call": call["id"], "motion": "go", "changes": words})[0] == 200
    person.until(lambda news: news["state"] == "over" or news["names"])  # until it was taken
    while (news := person.until(lambda news: news["state"] in ("asking", "over")))["state"] != "over":
        assert ["drum", -1.0] in news["names"]
        (waiting,) = (one for one in news["calls"] if one["open"])
        if waiting["id"] == call["id"]:
            person.post("/answer", {"call": call["id"], "motion": "go", "changes": []})
        else:
            person.post("/skip", {})
    running.ends()
    assert running.codes == [0]
    told = rehearsed(drive, tmp_path / "file", "--answers", str(running.out / "answers.txt"))
    assert told["answered"] == 1
    for name in ("memory.jsonl", "answers.txt", "frames.jsonl"):
        assert (running.out / name).read_bytes() == (tmp_path / "file" / name).read_bytes(), name
    assert "tap drum: -1 0.4012 0.5000 0.6000 0.8000, go" in (running.out / "answers.txt").read_text()
    assert (running.out / "index.html").exists()


def test_what_a_thing_was_named_in_a_like_scene_is_offered(
    answered: tuple[AnyTraverse, Rehearsal], drive: Path
) -> None:
    from companion.desk.drives.browser_desk import BrowserDesk

    engine, found = answered
    call = like(answered)
    judge = DriveJudge(load_config(drive.parent / "companion.toml"), engine)
    shown = Rehearsal(calls=[*found.calls, call])
    with BrowserDesk(judge, (), shown, open_drive(str(drive), 10.0)) as desk:
        asking = threading.Thread(target=desk.ask, args=[call, ""], daemon=True)
        asking.start()
        person = Person(desk.url)
        known = person.call()["known"]
        assert (known["word"], known["weight"], known["motion"]) == ("drum", -1.0, "go")
        assert known["text"] == "Still the drum you named at C1: −1, and go"
        assert person.post("/skip", {})[0] == 200
        asking.join(PATIENCE)
        assert not asking.is_alive()


def test_rubbish_strangers_and_what_comes_too_late_change_nothing(running: Running) -> None:
    person = running.person
    call = person.call()
    stranger = Person(f"http://{person.address[0]}:{person.address[1]}/?token=wrong")
    for path in ("/", "/events", "/calls/1-raw.jpg"):
        assert stranger.ask(path)[0] == 401
    of_another_site = {"content_type": "application/json", "origin": "http://evil.example"}
    assert person.ask("/answer", "POST", b"{}", **of_another_site)[0] == 403
    assert person.ask("/", host="evil.example")[0] == 421
    for path in ("/calls/99-raw.jpg", "/calls/1-raw.jpg%2f..", "/calls/../answers.txt", "/answers.txt"):
        assert person.ask(path)[0] == 404
    own = {"call": call["id"]}
    tap = {"tap": "a", "weight": 1, "box": [0, 0, 1, 1], "frame": 999}
    for told, why in (
        ({}, "motion is one of"),
        ({"motion": "none", "changes": [{"word": "mud", "weight": 1}]}, "wait for the next one"),
        ({"call": call["id"] + 1, "motion": "go"}, "is closed already"),
        ({**own, "motion": "go", "changes": [tap]}, "older picture"),
        ({**own, "motion": "none", "changes": [{"forget": "look"}]}, "would be read otherwise"),
    ):
        status, said = person.post("/answer", told)
        assert (status, why in said["problem"]) == (409, True), said
    assert person.news()["calls"][0]["answers"] == []
    assert person.post("/end", {})[0] == 200
    running.ends()
    assert not (running.out / "memory.jsonl").exists()
    assert "# " in (running.out / "answers.txt").read_text()


def test_ctrl_c_keeps_what_was_answered_and_a_page_that_was_closed_can_be_opened_again(
    drive: Path, tmp_path: Path
) -> None:
    out, config = tmp_path / "out", tmp_path / "companion.toml"
    config.write_text(CONFIG.replace('"dirt path" = 1.0\n', ""))  # so that it calls at once
    process = subprocess.Popen(
        [*COMMAND, "rehearse", str(drive), "--config", str(config), "--out", str(out), "--browser"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "BROWSER": "true"},
    )
    try:
        assert process.stdout is not None
        person = Person(process.stdout.readline().split()[-1])
        call = person.call()  # each request opens a page, and closes it
        water = [{"word": "water", "weight": -1}]
        person.post("/answer", {"call": call["id"], "motion": "none", "changes": water})
        wait_for(lambda: person.news()["calls"][0]["answers"], PATIENCE)
        assert person.call()["id"] == call["id"], "that does not cover it, so it waits"
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0
    assert "1 answered" in said
    assert " = water: -1\n" in (out / "answers.txt").read_text()
    assert len((out / "memory.jsonl").read_text().splitlines()) == 2


def test_a_port_that_there_is_not_or_that_is_taken_is_said(drive: Path, tmp_path: Path) -> None:
    config = str(drive.parent / "companion.toml")
    with pytest.raises(DriveError, match="70000 is not in 0"):
        rehearsing.run(str(drive), file=config, out=str(tmp_path / "out"), port=70_000)
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(OSError, match="in use"):
        rehearsing.run(str(drive), file=config, out=str(tmp_path / "out"), port=taken.getsockname()[1])


def test_without_its_packages_it_says_what_to_install(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "starlette.applications", None)
    monkeypatch.delitem(sys.modules, "companion.desk.drives.browser_desk", raising=False)
    config = str(drive.parent / "companion.toml")
    with pytest.raises(DriveError, match="pip install"):
        rehearsing.run(str(drive), file=config, out=str(tmp_path / "out"), port=0)
