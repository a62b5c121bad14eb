"""The console's program, asked by HTTP: what it shows, what it carries out, what it refuses."""

from __future__ import annotations

import io
import json
import re
import signal
import socket
import threading
import zipfile
from collections.abc import Callable, Iterator
from contextlib import closing
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from companion.wire import ids
from companion.wire.call_report import CallReport
from gcs_plugin.console.main import main
from tests.gcs_plugin.console.served import MISSING, Served

pytestmark = pytest.mark.skipif(bool(MISSING), reason="the extra ground is not installed")
GO = {"rover": 1, "call": 7, "motion": "go", "changes": []}
PAGE_BYTES = 200_000


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    made = Served()
    yield made
    made.close()


@pytest.fixture
def rover(served: Served, tiny_rover: Callable[..., Any], thing_call: CallReport) -> Iterator[Any]:
    made = tiny_rover(1, thing_call)
    served.rovers = [made]
    served.until(lambda: made.heard_ground and served.news()["rovers"] != [])
    yield made
    served.rovers = []


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_who_is_told_the_address_can_end_it_in_order(by: signal.Signals) -> None:
    Served().close(by)


def test_it_ends_though_a_page_is_open() -> None:
    made = Served()
    with socket.create_connection(made.address) as watching:
        watching.sendall(b"GET /events HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % made.address[1])
        assert watching.recv(64).startswith(b"HTTP/1.1 200")
        made.close()


def test_the_page_comes_from_here_under_a_strict_policy_and_is_small(served: Served) -> None:
    size = 0
    for path in ("/", "/look.css", "/style.css", "/favicon.svg", *(f"/{name}.js" for name in MODULES)):
        status, headers, content = served.ask(path)
        assert status == 200, path
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert b"innerHTML" not in content
        assert b"style=" not in content
        size += len(content)
    assert size < PAGE_BYTES
    assert b"<script>" not in served.ask("/")[2]


MODULES = (
    "main", "model", "rover", "console_card", "track", "alarm", "answer_card", "cards", "keys", "sending",
    "bar", "call_view", "picture", "boxes", "place", "plots", "words", "elements", "stream", "delay",
    "wording",
)  # fmt: skip


def test_an_answer_that_is_posted_reaches_the_rover_and_comes_back_acknowledged(
    served: Served, rover: Any
) -> None:
    served.until(lambda: any(call["open"] for call in served.news()["rovers"][0]["calls"]))
    assert served.post("answer", GO)[0] == 200
    served.until(lambda: rover.applied != [])
    assert rover.applied == [(7, ids.Motion.GO, ())]
    served.until(lambda: served.news()["rovers"][0]["calls"][0]["answers"][0]["tone"] == "good")
    status, told = served.post("answer", GO)
    assert status == 409
    assert "closed already" in json.loads(told)["problem"]


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://localhost"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
        {"Sec_Fetch_Site": "none"},
        {"Content_Type": "text/plain"},
        {"Content_Type": "application/x-www-form-urlencoded"},
        {"Host": "evil.example"},
        {"Host": "127.0.0.1.evil.example"},
    ],
)
def test_another_site_can_post_nothing(served: Served, rover: Any, headers: dict[str, str]) -> None:
    assert served.post("answer", GO, **headers)[0] in (403, 415, 421)
    assert rover.applied == []


def test_without_an_origin_nothing_is_carried_out(served: Served, rover: Any) -> None:
    assert served.ask("/answer", "POST", GO, Content_Type="application/json")[0] == 403
    assert served.ask("/answer", "PUT", GO, Content_Type="application/json")[0] == 405
    assert served.ask("/answer")[0] == 405
    assert served.post("answer", b"x" * 20_000)[0] == 413
    assert rover.applied == []


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(["answer", "policy", "undo", "fetch"]), st.binary(max_size=300))
def test_any_bytes_are_answered_with_what_is_wrong(served: Served, kind: str, body: bytes) -> None:
    status, told = served.post(kind, body)
    assert status == 409
    assert json.loads(told)["problem"]


@pytest.mark.parametrize("name", ["1/7/other.jpg", "1/7/..%2fsmall.jpg", "9/7/small.jpg", "1/7/small.jpg"])
def test_only_pictures_that_came_are_served(served: Served, name: str) -> None:
    assert served.ask(f"/pictures/{name}")[0] == 404


@pytest.mark.usefixtures("rover")
def test_calls_are_saved_as_a_zip(served: Served) -> None:
    served.until(lambda: served.news()["rovers"][0]["calls"] != [])
    for name, saved_as in (("7", "call-7"), ("007", "call-7"), ("all", "calls"), ("7,7", "calls")):
        status, headers, content = served.ask(f"/export/1/{name}.zip")
        assert (status, headers["content-type"]) == (200, "application/zip")
        assert headers["content-disposition"] == f'attachment; filename="rover-1-{saved_as}.zip"'
        assert headers["cache-control"] == "no-store"
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            assert archive.namelist() == ["report.html", "call-7/data.json"]
            told = json.loads(archive.read("call-7/data.json"))
            assert b"Unknown thing in the middle" in archive.read("report.html")
        assert (told["rover"], told["name"]) == (1, "C7")


@pytest.mark.parametrize(
    "name",
    [
        "1/8.zip",
        "1/7,8.zip",
        "9/7.zip",
        "9/all.zip",
        "1/7",
        "1/..%2f7.zip",
        "1/-7.zip",
        "1/7,.zip",
        "1/999999.zip",
    ],
)
@pytest.mark.usefixtures("rover")
def test_calls_that_are_not_known_are_not_saved(served: Served, name: str) -> None:
    assert served.ask(f"/export/{name}")[0] == 404
    assert served.ask("/export/1/7.zip", Host="evil.example")[0] == 421


def test_with_a_token_nothing_is_shown_and_nothing_is_taken_without_it(tmp_path: Path) -> None:
    token = "0123456789abcdef-TOKEN"
    (tmp_path / "token").write_text(f"{token}\n")
    (tmp_path / "map@home.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    options = ("--token-file", str(tmp_path / "token"), "--origin", "https://ground.example:8192")
    with closing(Served(*options, "--background", f"{tmp_path / 'map@home.png'}@47.1,8.0,47.0,8.2")) as made:
        made.url = "https://ground.example:8192"
        named = {"Host": "ground.example:8192"}
        assert made.ask("/", **named)[0] == 401
        assert made.post("answer", GO, **named)[0] == 401
        assert made.ask("/export/1/all.zip", **named)[0] == 401
        status, headers, _ = made.ask(f"/?token={token}", **named)
        assert status == 303
        assert "httponly" in headers["set-cookie"].lower()
        cookie = {"Cookie": headers["set-cookie"].split(";")[0]}
        assert made.ask("/", **named, **cookie)[0] == 200
        assert made.ask("/background", **named)[0] == 401
        status, headers, _ = made.ask("/background", **named, **cookie)
        assert (status, headers["content-type"]) == (200, "image/png")
        assert made.post("answer", GO, **named, **cookie)[0] == 409, "no rover is heard"
        assert made.post("answer", GO, Host="evil.example", **cookie)[0] == 421
        assert made.post("answer", GO, Origin="https://evil.example", **named, **cookie)[0] == 403


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--host", "0.0.0.0"], "--token-file and --origin"),
        (["--host", "example.org"], "127.0.0.1"),
        (["--port", "70000"], "65535"),
        (["--connect", "udp:14550"], "is not a link"),
        (["--token-file", "/nowhere"], "nowhere"),
        (["--origin", "ground.local"], "--origin"),
        (["--background", "field.png"], "FILE@NORTH,WEST,SOUTH,EAST"),
        (["--background", "/nowhere.png@47.1,8.0,47.0,8.2"], "No such file"),
    ],
)
def test_options_that_cannot_be_are_refused_with_what_to_do(
    options: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--no-browser", *options]) == 2
    assert why in capsys.readouterr().err


def test_every_option_is_on_the_page_of_the_manual(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    options = set(re.findall(r"--[a-z-]+", capsys.readouterr().out)) - {"--help"}
    manual = (Path(__file__).parents[3] / "docs" / "console.md").read_text()
    assert {option for option in options if option not in manual} == set()


def test_a_call_is_posted_to_the_address_in_a_file(
    tmp_path: Path, tiny_rover: Callable[..., Any], thing_call: CallReport
) -> None:
    taken: list[tuple[str, bytes]] = []

    class Hook(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            taken.append((self.path, self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    hook = HTTPServer(("127.0.0.1", 0), Hook)
    threading.Thread(target=hook.serve_forever, daemon=True).start()
    file = tmp_path / "address"
    file.write_text(f"http://127.0.0.1:{hook.server_port}/topic?auth=SECRET\n")
    with closing(hook.socket), closing(Served("--alert-url-file", str(file))) as made:
        made.rovers.append(tiny_rover(1, thing_call))
        made.until(lambda: bool(taken))
        hook.shutdown()
    ((path, text),) = taken
    assert path == "/topic?auth=SECRET"
    assert text.startswith(b"C7 unknown thing ahead")


def test_a_file_without_an_address_is_said_and_not_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "address"
    for written in ("", "ntfy.sh/SECRET"):
        file.write_text(written)
        assert main(["--alert-url-file", str(file), "--connect", "udpin:127.0.0.1:0"]) == 2
        told = capsys.readouterr().err
        assert str(file) in told
        assert "https://" in told
        assert "SECRET" not in told
