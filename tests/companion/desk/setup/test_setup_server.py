"""What the server of a set-up lets in, and how it answers."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from companion.cli import main
from companion.desk.setup.threads import DaemonThreads
from tests.companion.desk.browsing import Browsing
from tests.waiting import wait_for

pytestmark = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("starlette", "uvicorn")), reason="starlette is not installed"
)


class Clock:
    """A clock that stands until it is moved."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def server(tmp_path: Path, clock: Clock) -> Iterator[Any]:
    from companion.desk.setup.server import SetupServer
    from companion.desk.setup.session import SetupSession

    assert main(["init", str(tmp_path)]) == 0
    with SetupServer(SetupSession(tmp_path / "companion.toml"), clock=clock) as made:
        yield made


@pytest.fixture
def page(server: Any) -> Browsing:
    return Browsing(server.url)


@pytest.mark.slow
def test_only_this_computer_is_served_and_only_who_knows_the_token(page: Browsing) -> None:
    assert page.address[0] == "127.0.0.1"
    assert page.ask("/state.json")[0] == 200
    page.token = "wrong"
    for path in ("/", "/state.json", "/frame.jpg", "/camera.json", "/job/listen.json"):
        assert page.ask(path)[0] == 401
    assert page.post("/write", {})[0] == 401


def test_another_site_may_post_nothing(page: Browsing) -> None:
    assert page.post("/draft", {"changes": {"camera.rate": 5}}, origin="http://evil.example")[0] == 403
    assert page.post("/draft", {"changes": {"camera.rate": 5}}, content_type="text/plain")[0] == 415
    assert page.ask("/state.json", host="evil.example")[0] == 421


@pytest.mark.slow
@pytest.mark.parametrize("body", [b"", b"[]", b"nothing", b"{", b'{"changes": 1}', b"\xff", b"[" * 9000])
def test_rubbish_is_refused_with_a_reason(page: Browsing, body: bytes) -> None:
    for path in ("/draft", "/drag"):
        status, told = page.post(path, body)
        assert status == 409
        assert told["problem"]


def test_a_body_is_bounded(page: Browsing) -> None:
    assert page.post("/draft", b" " * (17 << 10))[0] == 413


def test_a_change_is_answered_with_the_new_state_and_a_wrong_one_with_why(
    page: Browsing, tmp_path: Path
) -> None:
    status, told = page.post("/draft", {"changes": {"camera.rate": 5.0}})
    assert status == 200
    assert told["changed"] == ["camera.rate"]
    status, told = page.post("/draft", {"changes": {"camera.rate": 500.0}})
    assert status == 409
    assert "0.5 to 60" in told["problem"]
    assert page.post("/write", {})[0] == 200
    assert "rate = 5.0" in (tmp_path / "companion.toml").read_text()


def test_a_job_is_started_by_a_post_alone_and_tells_its_result(page: Browsing) -> None:
    assert json.loads(page.ask("/job/ports.json")[1]) == {"state": "idle"}
    assert page.post("/job/ports", {})[1]["state"] in ("running", "done")
    done = wait_for(
        lambda: found if (found := json.loads(page.ask("/job/ports.json")[1]))["state"] == "done" else None
    )
    assert any(port["url"].startswith("udpin:") for port in done["result"])
    assert page.post("/job/rm", {})[0] == 409
    assert page.post("/job/listen", {"url": "nowhere"})[0] == 200
    told = wait_for(
        lambda: found if "problem" in (found := json.loads(page.ask("/job/listen.json")[1])) else None
    )
    assert "not understood" in told["problem"]


def test_without_a_picture_there_is_none_to_judge(page: Browsing) -> None:
    assert page.ask("/frame.jpg")[0] == 404
    assert page.ask("/judged.jpg")[0] == 404
    status, told = page.post("/judge", {})
    assert status == 409
    assert "camera" in told["problem"]


def test_calls_that_hang_delay_neither_what_is_told_nor_the_end(
    server: Any, page: Browsing, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = set(threading.enumerate())
    begun, over = threading.Semaphore(0), threading.Event()

    def hang() -> dict[str, Any]:
        begun.release()
        over.wait(60.0)
        return {}

    server._doing = DaemonThreads(2)
    monkeypatch.setattr(server._session.draft, "change", lambda *_changes: hang())
    try:
        for _ in range(2):
            threading.Thread(
                target=lambda: page.post("/draft", {"changes": {"camera.rate": 5.0}}), daemon=True
            ).start()
            assert begun.acquire(timeout=10.0)
        status, told = page.post("/draft", {"changes": {"camera.rate": 5.0}})
        assert status == 409
        assert "still runs" in told["problem"]
        assert page.ask("/state.json")[0] == 200
        assert all(one.daemon for one in set(threading.enumerate()) - others)
    finally:
        over.set()


def test_every_page_s_files_are_there(page: Browsing) -> None:
    status, index = page.ask("/")
    assert status == 200
    assert b"/main.js" in index
    for name in ("main.js", "store.js", "look.css", "style.css", "elements.js", "boxes.js", "words.js"):
        assert page.ask(f"/{name}")[0] == 200
    assert page.ask("/../session.py")[0] == 404


def test_it_is_idle_when_nobody_opened_or_changed_anything_for_an_hour(
    server: Any, page: Browsing, clock: Clock
) -> None:
    clock.now += 3500
    page.post("/draft", {"changes": {"camera.rate": 5.0}})
    clock.now += 3500
    assert not server.is_idle
    page.ask("/job/ports.json")  # a page that is left open asks for these by itself
    clock.now += 200
    assert server.is_idle


def test_a_file_that_does_not_exist_is_begun_only_where_its_name_is_the_shipped_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["setup", str(tmp_path / "other.toml")]) == 2
    assert "`companion init` writes one" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_file_with_a_problem_is_not_opened(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["init", str(tmp_path)]) == 0
    file = tmp_path / "companion.toml"
    file.write_text(file.read_text().replace("rate = 10.0", "rate = 0", 1))
    assert main(["setup", str(file)]) == 2
    assert "camera.rate" in capsys.readouterr().err
