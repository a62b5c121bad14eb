"""Lets a hostile rover talk to the console and to the terminal client."""

from __future__ import annotations

import contextlib
import http.client
import io
import json
import subprocess
import sys
import threading
import time
import urllib.request
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from bench.attack.gate import Owner
from bench.attack.hostile_rover import INCIDENT, SYSTEM, HostilePage, HostileRover
from bench.attack.outcome import AttackOutcome, peak_memory
from bench.console.stage import start_console
from companion.sim.demo.rehearsal import free_port
from gcs_plugin.terminal.session import HELP

UNANSWERED, MOST_MB = 2.0, 300
"""s for which the page or a typed line may wait, and what a station may take."""
SECONDS, QUICK = 14.0, 6.0
"""Of files alone, and then of a flood besides."""
MEMBERS, QUICK_MEMBERS = 60_000, 5_000
_ZIPS = f"{INCIDENT}.zip", f"{INCIDENT}-short.zip"
_POSTS: tuple[tuple[str, dict[str, Any]], ...] = (
    *(("fetch", {"name": name}) for name in _ZIPS),
    ("incident", {"call": 0}),
    ("fetch", {"what": "check"}),
    ("fetch", {"what": "calls"}),
    ("fetch", {"what": "large", "call": 1}),
)
_TYPED = ("status", "calls", "words", f"rover {SYSTEM} picture 1")
_ASKS_EVERY = 2.0


def stations(folder: Path, *, quick: bool) -> AttackOutcome:
    """Serve hostile files, then flood as well, and look at all that a person would see."""
    outcome, over, problems = AttackOutcome(), threading.Event(), dict[str, str]()
    page, ports = HostilePage(QUICK_MEMBERS if quick else MEMBERS), (free_port(), free_port())
    kept, token = folder / "kept", folder / "token"
    token.write_text("0123456789abcdef")
    links = [f"udpin:127.0.0.1:{port}" for port in ports]
    options = ["--incidents", str(kept), "--log", str(folder / "log"), "--page", f"{SYSTEM}={page.url}"]
    console, url = start_console([links[0]], folder, *options, "--page-token-file", str(token))
    there = urlsplit(url)
    owner = Owner((str(there.hostname), there.port or 0), over, "/", 0.05)
    typist = _Typist(folder, links[1])
    rovers = [HostileRover(("127.0.0.1", port)) for port in ports]
    try:
        owner.start()
        typist.start()
        for floods in (False, True):
            until, asks_at = time.monotonic() + (QUICK if quick else SECONDS), 0.0
            while (now := time.monotonic()) < until:
                for rover in rovers:
                    rover.floods = floods
                    rover.step()
                due = now >= asks_at
                if due:
                    asks_at = now + _ASKS_EVERY
                    threading.Thread(target=_post_all, args=(url,), daemon=True).start()
                typist.type("help", *(_TYPED if due else ()))
                time.sleep(0.002)
            try:
                told = _events(url)
                outcome.reached += ["the page: an escape sequence"] * (
                    not all(map(str.isprintable, _texts(told)))
                )
                outcome.reached += _saved(url)
                problems |= _problems(told[-1])
            except (OSError, http.client.HTTPException) as error:
                outcome.reached.append(f"the console gives no answer: {error}")
        memory = {"console_mb": peak_memory(console.process.pid), "terminal_mb": peak_memory(typist.pid)}
    finally:
        over.set()
        owner.join(20.0)
        console.stop()
        typist.stop()
        page.close()
        for rover in rovers:
            rover.close()
    log = (folder / "log").read_text(encoding="utf-8").splitlines()
    outcome.reached += ["the terminal: an escape sequence"] * bool(typist.unprintable)
    outcome.reached += ["the console's log: an escape sequence"] * (not all(map(str.isprintable, log)))
    outcome.reached += ["the console's folder: a hostile zip"] * (kept.exists() and any(kept.iterdir()))
    waited = {"longest_page_s": round(owner.longest, 2), "longest_typed_s": round(typist.longest, 2)}
    outcome.reached += [f"{name}: {s}" for name, s in waited.items() if s > UNANSWERED]
    outcome.reached += [f"{name}: {mb}" for name, mb in memory.items() if mb > MOST_MB]
    files = len(rovers[0].asked | rovers[1].asked)
    outcome.figures = {**waited, **memory, "files": files, "zips": problems}
    return outcome


class _Typist(threading.Thread):
    """Runs the terminal client, types there and reads. longest: s until a typed line was answered, at worst.

    unprintable: lines that hold what could control a terminal.
    """

    def __init__(self, folder: Path, link: str) -> None:
        super().__init__(daemon=True)
        command = [sys.executable, "-m", "gcs_plugin.terminal", "--connect", link, "--pictures", str(folder)]
        self._terminal = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.pid, self.longest, self.unprintable = self._terminal.pid, 0.0, list[str]()
        self._asked_at: float | None = None

    def run(self) -> None:
        assert self._terminal.stdout is not None
        for line in self._terminal.stdout:
            text = line.decode(errors="replace").removesuffix("\n")
            if not text.isprintable() and len(self.unprintable) < 10:
                self.unprintable.append(text)
            if HELP[0] in text:
                self._note()
                self._asked_at = None

    def type(self, *lines: str) -> None:
        """Type lines, help among them, once what was typed before is answered."""
        if self._asked_at is None:
            assert self._terminal.stdin is not None
            self._asked_at = time.monotonic()
            with contextlib.suppress(OSError):
                self._terminal.stdin.write("".join(f"{line}\n" for line in lines).encode())
                self._terminal.stdin.flush()

    def stop(self) -> None:
        """End the client."""
        self._note()
        self._terminal.kill()
        self._terminal.wait(10.0)

    def _note(self) -> None:
        if (asked_at := self._asked_at) is not None:
            self.longest = max(self.longest, time.monotonic() - asked_at)


def _post_all(url: str) -> None:
    for kind, body in _POSTS:
        content, origin = json.dumps({"rover": SYSTEM, **body}).encode(), url.rstrip("/")
        headers = {"Content-Type": "application/json", "Origin": origin}
        with contextlib.suppress(OSError):
            urllib.request.urlopen(urllib.request.Request(f"{url}{kind}", content, headers), timeout=10.0)


def _events(url: str) -> list[Any]:
    """Return all that a page is told when it opens; the newest state is the last."""
    found, name = list[Any](), ""
    with urllib.request.urlopen(f"{url}events", timeout=10.0) as stream:
        while name != "news":
            name = stream.readline().decode().removeprefix("event: ").strip()
            found.append(json.loads(stream.readline().decode().removeprefix("data: ")))
            stream.readline()
    return found


def _problems(news: Any) -> dict[str, str]:
    """Return why zips were refused, by name."""
    calls = (call for rover in news["rovers"] for call in rover["calls"])
    files = (file for call in calls for file in call["incident"]["files"])
    return {file["name"]: file["problem"] for file in files if file.get("problem")}


def _saved(url: str) -> list[str]:
    """Return what the saved report holds that no rover may write there."""
    with urllib.request.urlopen(f"{url}export/{SYSTEM}/all.zip", timeout=10.0) as answer:
        report = zipfile.ZipFile(io.BytesIO(answer.read())).read("report.html").decode()
    found = ["the report: a script"] * ("<script" in report)
    return found + ["the report: an escape sequence"] * (not report.replace("\n", "").isprintable())


def _texts(told: Any) -> Iterator[str]:
    """Yield all texts of JSON values."""
    if isinstance(told, str):
        yield told
    elif isinstance(told, dict | list):
        for one in [*told, *told.values()] if isinstance(told, dict) else told:
            yield from _texts(one)
