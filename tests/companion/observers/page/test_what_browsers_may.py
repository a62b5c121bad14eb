"""A real web process, asked over a real socket: what it shows, and what it refuses."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from companion.observers.page.page import missing
from companion.pages import access
from companion.pages.access import Gate, WrongTokens
from companion.pages.listen import hashed
from tests.companion.observers.page.played import JPEG, TOKEN, Stage
from tests.waiting import wait_for

pytestmark = pytest.mark.skipif(bool(missing()), reason="the extra web is not installed")


def test_the_page_and_all_that_it_loads_come_from_here_under_a_strict_policy(stage: Stage) -> None:
    page = stage.get("/")
    assert page.status == 200
    assert b"AnyTraverse" in page.body
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert page.headers["x-content-type-options"] == "nosniff"
    assert page.headers["cache-control"] == "no-store"
    assert b"<script>" not in page.body
    assert b"://" not in page.body
    assert b"style=" not in page.body
    for path, kind in (
        ("/main.js", "text/javascript"),
        ("/style.css", "text/css"),
        ("/favicon.svg", "image/svg+xml"),
    ):
        found = stage.get(path)
        assert (found.status, found.headers["content-type"].split(";")[0]) == (200, kind)


def test_health_metrics_and_documents_say_what_was_told(stage: Stage) -> None:
    health = json.loads(stage.get("/healthz").body)
    assert health.pop("age") < 3.0
    assert health == {"ok": True, "state": "ok", "why": ""}
    lines = stage.get("/metrics").body.decode().splitlines()
    assert {
        "anytraverse_up 1.0",
        "anytraverse_well 1.0",
        'anytraverse_state{state="ok"} 1.0',
        'anytraverse_state{state="fault"} 0.0',
        'anytraverse_policy{policy="hold"} 1.0',
        'anytraverse_policy{policy="guide"} 0.0',
        "# TYPE anytraverse_frames_judged_total counter",
        "anytraverse_frames_judged_total 7.0",
        'anytraverse_checks{verdict="warn"} 1.0',
    } <= set(lines)
    (free,) = (line.split()[1] for line in lines if line.startswith("anytraverse_memory_free_bytes "))
    assert float(free) == 512 << 20
    for name in ("status", "state", "check"):
        assert json.loads(stage.get(f"/{name}.json").body) == stage.news[name]
    head = stage.get("/healthz", "HEAD")
    assert (head.status, head.body) == (200, b"")


def test_a_fault_is_not_healthy(stage: Stage) -> None:
    stage.news["status"]["state"] = "fault"
    try:
        stage.until(lambda: stage.get("/healthz").status == 503)
        assert json.loads(stage.get("/healthz").body)["why"] == "fault"
        assert b"anytraverse_well 0.0" in stage.get("/metrics").body
    finally:
        stage.news["status"]["state"] = "ok"
        stage.ready()


@pytest.mark.slow
def test_old_news_are_not_healthy_and_no_figure_of_them_is_given(stage: Stage) -> None:
    wait_for(lambda: stage.get("/healthz").status != 200, 10.0)  # nothing is told meanwhile
    try:
        assert json.loads(stage.get("/healthz").body)["why"] == "no news from the companion"
        metrics = stage.get("/metrics").body.decode()
        assert "anytraverse_up 0.0" in metrics
        assert "frames_judged" not in metrics
        assert stage.get("/state.json").status == 503
    finally:
        stage.ready()


@pytest.mark.slow
def test_a_picture_is_drawn_only_while_somebody_watches(stage: Stage) -> None:
    before = stage.frames
    until = time.monotonic() + 1.3
    stage.until(lambda: time.monotonic() > until)
    assert stage.frames == before
    assert stage.get("/live.jpg").status == 404
    with socket.create_connection(stage.address, timeout=5.0) as watching:
        watching.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        began = time.monotonic()
        stage.until(lambda: stage.frames >= before + 2)
        assert time.monotonic() - began > 0.7, "one a second"
        stage.until(lambda: stage.get("/live.jpg").body == JPEG)
        time.sleep(0.2)
        heard = watching.recv(1 << 20)
        assert b"event: news" in heard
        assert b"event: picture" in heard


def test_calls_and_log_are_read_from_the_state_folder(stage: Stage) -> None:
    folder = stage.folder
    (folder / "calls" / "7.json").write_text('{"id":7,"reasons":["unknown_scene"],"outcome":null}')
    (folder / "calls" / "7.jpg").write_bytes(b"small")
    (folder / "calls" / "7-large.jpg").write_bytes(b"large")
    (folder / "calls" / "7-raw.jpg").write_bytes(b"raw")
    (folder / "logs" / "companion.log").write_text("a line\n")
    assert [one["id"] for one in json.loads(stage.get("/calls.json").body)] == [7]
    assert stage.get("/calls/7.jpg").body == b"small"
    assert stage.get("/calls/7-large.jpg").body == b"large"
    assert stage.get("/calls/7-raw.jpg").body == b"raw"
    assert stage.get("/calls/8.jpg").status == 404
    assert stage.get("/log.txt").body == b"a line"


def test_the_picture_of_a_scene_without_a_call_is_read_by_its_hash_alone(stage: Stage) -> None:
    folder = stage.folder / "scenes"
    folder.mkdir()
    (folder / "0123456789abcdef.jpg").write_bytes(b"a picture")
    assert stage.get("/scenes/0123456789abcdef.jpg").body == b"a picture"
    for name in ("0123456789abcdee.jpg", "0123456789ABCDEF.jpg", "..%2Fstatus.json", "1.jpg"):
        assert stage.get(f"/scenes/{name}").status == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE", "PROPFIND"])
def test_nothing_but_reading_is_allowed(stage: Stage, method: str) -> None:
    answer = stage.get("/healthz", method)
    assert answer.status == 405
    assert answer.headers["allow"] == "GET, HEAD"


def test_a_request_with_a_body_is_refused(stage: Stage) -> None:
    said = stage.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999999\r\n\r\nxxxx")
    assert said.startswith(b"HTTP/1.1 413")
    assert b"connection: close" in said


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[::2]", "localhost."]
)
def test_another_name_for_this_computer_is_refused(stage: Stage, host: str) -> None:
    assert stage.get("/state.json", headers={"Host": host}).status == 421


@pytest.mark.parametrize("host", ["localhost:9", "127.0.0.1", "[::1]:8191", "LOCALHOST"])
def test_its_own_names_pass_with_any_port_since_ssh_may_forward_another(stage: Stage, host: str) -> None:
    assert stage.get("/state.json", headers={"Host": host}).status == 200


def test_each_address_of_this_computer_that_it_listens_on_may_be_asked(tmp_path: Path) -> None:
    with closing(Stage(tmp_path, listen="127.0.0.2:0")) as stage:
        stage.ready()
        assert stage.get("/", headers={"Host": "127.0.0.2.evil.example"}).status == 421


def test_another_site_may_link_here_but_load_nothing(stage: Stage) -> None:
    other = {"Sec-Fetch-Site": "cross-site"}
    assert stage.get("/", headers=other).status == 200
    assert stage.get("/live.jpg", headers=other).status == 403
    assert stage.get("/events", headers=other).status == 403


SECRET = "it must not be read"
NAMES = r".. . calls 7 .jpg secret %2e%2e %2f ..%2fsecret \ %00 ~ etc passwd static"
PARTS = st.sampled_from([*NAMES.split(), ""])


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(PARTS | st.text(max_size=6).map(quote), min_size=1, max_size=5))
def test_no_path_leads_out_of_what_is_shown(stage: Stage, parts: list[str]) -> None:
    folder = stage.folder
    (folder / "secret").write_text(SECRET)
    (folder / "calls" / "secret.jpg").write_text(SECRET)
    answer = stage.get("/" + "/".join(parts))
    assert answer.status in (200, 307, 400, 404)
    assert SECRET.encode() not in answer.body
    assert b"root:" not in answer.body


@pytest.mark.parametrize(
    "path", ["/calls/99999999999.jpg", "/calls/" + "9" * 5000 + ".jpg", "/calls/%D9%A7.jpg", "/calls/-7.jpg"]
)
def test_a_number_that_is_none_is_no_call(stage: Stage, path: str) -> None:
    assert stage.get(path).status == 404


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(min_size=1, max_size=200))
def test_rubbish_ends_its_own_connection_only(stage: Stage, rubbish: bytes) -> None:
    with socket.create_connection(stage.address, timeout=2.0) as connection:
        connection.sendall(rubbish + b"\r\n\r\n")
    assert stage.get("/healthz").status in (200, 503)
    assert stage.page.restarted == 0


def test_a_head_that_never_ends_is_refused(stage: Stage) -> None:
    said = stage.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"x" * 100_000)
    assert said.startswith(b"HTTP/1.1 400")


@pytest.mark.slow
def test_who_does_not_know_the_token_sees_nothing(tmp_path: Path) -> None:
    stage = Stage(tmp_path, token=TOKEN)
    known = {"Authorization": f"Bearer {TOKEN}"}
    try:
        stage.until(lambda: stage.up() and stage.get("/healthz", headers=known).status == 200)
        for path in ("/", "/main.js", "/healthz", "/metrics", "/events", "/live.jpg", "/log.txt", "/nothing"):
            answer = stage.get(path)
            assert answer.status == 401, path
            assert TOKEN.encode() not in answer.body
        assert stage.get("/", headers={"Authorization": f"Bearer {TOKEN[:-1]}"}).status == 401
        assert stage.get(f"/?token={TOKEN}x").status == 401
        assert b"wrong_tokens_total 2.0" in stage.get("/metrics", headers=known).body
        entered = stage.get(f"/?token={TOKEN}")
        cookie = entered.headers["set-cookie"]
        name = cookie.partition("=")[0]
        for wrong in (TOKEN[:-1], TOKEN, "", "ü" * 16):
            assert stage.get("/", headers={"Cookie": f"{name}={quote(wrong)}"}).status == 401
        assert (entered.status, entered.headers["location"]) == (303, "/")
        assert "httponly" in cookie.lower()
        assert "samesite=strict" in cookie.lower()
        assert TOKEN not in cookie
        entered_again = {"Cookie": cookie.split(";")[0]}
        assert stage.get("/", headers=entered_again).status == 200
        assert stage.get(f"/?token={TOKEN}", headers=entered_again).status == 303, "no token stays in the bar"
        assert TOKEN not in " ".join(Path(f"/proc/{stage.pid()}/cmdline").read_text().split("\0"))
    finally:
        stage.close()


def through_the_gate(
    token: str,
    query: str = "",
    *,
    port: int = 8191,
    wrong_tokens: WrongTokens | None = None,
    **headers: bytes,
) -> Any:
    """The first message that the gate answers with; None where it lets the request in."""
    told: list[Any] = []

    async def app(*_: object) -> None:
        told.append(None)

    async def send(message: Any) -> None:
        told.append(message)

    named = [(name.encode(), value) for name, value in headers.items()]
    scope = {
        "type": "http",
        "method": "GET",
        "path": "/",
        "query_string": query.encode(),
        "headers": named,
        "server": ("127.0.0.1", port),
        "client": ("10.0.0.7", 5000),
    }
    asyncio.run(
        Gate(app, token_hash=hashed(token), own_address="", wrong_tokens=wrong_tokens)(scope, app, send)
    )
    return told[0]


def own_cookie(token: str, port: int = 8191) -> bytes:
    """The cookie that the gate gives to who knows the token, without its attributes."""
    given = dict(through_the_gate(token, f"token={token}", port=port)["headers"])[b"set-cookie"]
    return bytes(given).partition(b";")[0]


def test_the_pages_of_two_rovers_on_localhost_do_not_log_each_other_out() -> None:
    one, again, other = (own_cookie(token).partition(b"=")[0] for token in (TOKEN, TOKEN, TOKEN + "2"))
    assert one == again != other


def test_a_cookie_counts_for_30_days_on_its_port_and_with_its_token(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [1_790_000_000.0]
    monkeypatch.setattr("companion.pages.access.time.time", lambda: clock[0])
    cookie = own_cookie(TOKEN)
    renamed = cookie.partition(b"=")[2]
    assert through_the_gate(TOKEN, cookie=cookie) is None
    for port, token in ((8192, TOKEN), (8191, TOKEN + "2")):
        name = own_cookie(token, port=port).partition(b"=")[0]
        assert through_the_gate(token, port=port, cookie=name + b"=" + renamed)["status"] == 401
    name, _, value = cookie.partition(b"=")
    until, _, proof = value.partition(b".")
    later = str(int(until) + 1).encode()
    assert through_the_gate(TOKEN, cookie=name + b"=" + later + b"." + proof)["status"] == 401
    clock[0] += 30 * 24 * 3600
    assert through_the_gate(TOKEN, cookie=cookie) is None
    clock[0] += 1
    assert through_the_gate(TOKEN, cookie=cookie)["status"] == 401
    clock[0] = 0.0
    assert through_the_gate(TOKEN, cookie=cookie)["status"] == 401, (
        "else a clock set back would keep it alive"
    )


@pytest.mark.parametrize("wrong", [TOKEN[:-1], TOKEN + "x", "", TOKEN.lower(), "ü" * 16, "\ud800"])
def test_a_token_that_is_nearly_right_is_wrong(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access, "_SLOWED", 0.0)
    given = quote(wrong, errors="surrogatepass")
    assert through_the_gate(TOKEN, f"token={given}")["status"] == 401
    assert through_the_gate(TOKEN, authorization=b"Bearer " + given.encode())["status"] == 401


def test_wrong_tokens_are_counted_logged_once_a_minute_and_answered_late(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    waited: list[float] = []

    async def sleep(seconds: float) -> None:
        waited.append(seconds)

    monkeypatch.setattr("companion.pages.access.asyncio.sleep", sleep)
    wrong = WrongTokens()
    for number in range(3):
        refused = through_the_gate(TOKEN, f"token={TOKEN}{number}", wrong_tokens=wrong)
        assert refused["status"] == 401
    bearer = b"Bearer " + TOKEN.encode()
    assert through_the_gate(TOKEN, wrong_tokens=wrong, authorization=bearer + b"x")["status"] == 401
    assert through_the_gate(TOKEN, wrong_tokens=wrong)["status"] == 401, "none was given"
    assert through_the_gate(TOKEN, wrong_tokens=wrong, authorization=bearer) is None
    assert (wrong.count, len(waited)) == (4, 4)
    assert [record.getMessage() for record in caplog.records] == [
        "a wrong token from 10.0.0.7, 1 since the start"
    ]
    assert TOKEN not in caplog.text


@pytest.mark.parametrize("beside", [b'a="', b'a="\\"', b"[=]", b"\xff", b"", b"a=" + 4000 * b'\\"'])
def test_the_cookie_is_found_beside_any_others(beside: bytes) -> None:
    cookie = own_cookie(TOKEN)
    assert through_the_gate(TOKEN, cookie=beside + b"; " + cookie) is None
    assert through_the_gate(TOKEN, cookie=cookie + b";" + beside) is None
    assert through_the_gate(TOKEN, cookie=cookie + b"0; " + cookie) is None
    assert through_the_gate(TOKEN, cookie=beside + b"; x" + cookie)["status"] == 401
    assert through_the_gate(TOKEN, cookie=beside + b"; " + cookie + b"0")["status"] == 401


@pytest.mark.parametrize("token", ["", TOKEN])
def test_headers_of_more_than_8_kb_are_refused_before_anything_else(token: str) -> None:
    assert through_the_gate(token, cookie=b'a="' + 30_000 * b'\\"')["status"] == 431
    assert through_the_gate(token, host=b"evil.example", x=8192 * b"x")["status"] == 431


def test_the_process_has_stepped_back_before_it_loads_what_it_needs(tmp_path: Path) -> None:
    (tmp_path / "uvicorn.py").write_text(
        "import os\nos._exit(os.nice(0) + (open('/proc/self/oom_score_adj').read() == '1000\\n'))"
    )
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[4])])
    command = [sys.executable, "-m", "companion.observers.page", "0", "0", str(os.getpid())]
    ran = subprocess.run(command, check=False, env={**os.environ, "PYTHONPATH": path})
    assert ran.returncode == min(os.nice(0) + 10, 19) + 1


def test_the_process_steps_back_behind_all_others(stage: Stage) -> None:
    pid = stage.pid()
    assert os.getpriority(os.PRIO_PROCESS, pid) >= 10
    assert Path(f"/proc/{pid}/oom_score_adj").read_text().strip() == "1000"
