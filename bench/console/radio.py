"""Measures the console over a radio: `python -m bench.console.radio --baud 9600 --loss 0.3`.

A simulated rover with its daemon raises calls; between it and the console a relay carries every frame in both
directions, at the radio's rate and with its loss. Times are those of the page, in seconds since the rover
captured the frame that the call is about: until the call stands there, until its picture does. An answer's
are in seconds since the click. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any

from bench.console.stage import CHROMIUM, Rover, start_console
from bench.link.radio_model import LinkConditions, RadioModel
from companion.sim.field.router import DatagramParser

READS = 2.5
"""Seconds for which a person reads a call with its picture."""
_WATCH = """
window.seen = {};
const note = (call, what) => { (window.seen[call] ??= {})[what] ??= Date.now() / 1000; };
setInterval(() => {
  for (const card of document.querySelectorAll(".open .call")) {
    const call = /([CH])(\\d+)/.exec(card.querySelector("h3").textContent);
    if (!call) continue;
    note(call[2], "shown");
    const picture = card.querySelector(".shot.small img:not([hidden])");
    if (picture?.complete && picture.naturalWidth) note(call[2], "picture");
    for (const row of card.querySelectorAll(".becoming li")) {
      if (row.dataset.tone === "good") note(call[2], "acknowledged");
      if (row.textContent.includes("drives on")) note(call[2], "driven_on");
    }
  }
}, 30);
"""


class _Relay:
    """Carries datagrams between a console, which speaks first, and `link` as a bad radio would."""

    def __init__(self, link: str, weather: LinkConditions, seed: int) -> None:
        self._rover, self._ground = _socket(), _socket()
        self._rover.connect(("127.0.0.1", int(link.rpartition(":")[2])))
        self._up, self._down = RadioModel(weather, f"up {seed}"), RadioModel(weather, f"down {seed}")
        self._ended = threading.Event()
        self.link = f"udpout:127.0.0.1:{self._ground.getsockname()[1]}"
        self.up_bytes = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def lost(self) -> float:
        """The share of frames that it lost on the way to the console."""
        return self._up.lost / max(1, self._up.put_in)

    def close(self) -> None:
        """End it."""
        self._ended.set()
        self._thread.join(5.0)
        self._rover.close()
        self._ground.close()

    def _run(self) -> None:
        parsers = DatagramParser(), DatagramParser()
        console: Any = None
        while not self._ended.wait(0.004):
            now = time.monotonic()
            for data, _ in _received(self._rover):
                for frame in parsers[0].frames(data):
                    content = bytes(frame.get_msgbuf())
                    self.up_bytes += len(content)
                    self._up.put(content, now)
            for data, sender in _received(self._ground):
                console = sender
                for frame in parsers[1].frames(data):
                    self._down.put(bytes(frame.get_msgbuf()), now)
            for out in self._up.take(now):
                if console is not None:
                    self._ground.sendto(out, console)
            for out in self._down.take(now):
                with contextlib.suppress(OSError):
                    self._rover.send(out)


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.settimeout(0.0)
    return made


def _received(source: socket.socket) -> list[tuple[bytes, Any]]:
    found: list[tuple[bytes, Any]] = []
    with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
        while len(found) < 64:
            found.append(source.recvfrom(4096))
    return found


def main() -> int:
    """Answer calls with go as soon as they were read, and print how long everything took."""
    options = _options()
    from playwright.sync_api import sync_playwright

    out = Path(options.out or tempfile.mkdtemp(prefix="console-radio-"))
    out.mkdir(parents=True, exist_ok=True)
    errors: list[str] = []
    clicked: dict[str, float] = {}
    with ExitStack() as stack, sync_playwright() as play:
        rover = Rover(out / "rover", options.seed, network=False, baud=options.baud)
        stack.callback(rover.close)
        weather = LinkConditions(loss=options.loss, rate=options.baud / 10)
        relay = _Relay(rover.link, weather, options.seed)
        stack.callback(relay.close)
        console, url = start_console([relay.link], out)
        stack.callback(console.stop)
        page = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]).new_page(
            viewport={"width": 1280, "height": 900}
        )
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(url)
        page.evaluate(_WATCH)
        rover.drive()
        began = time.monotonic()
        done: set[str] = set()
        while time.monotonic() - began < options.seconds and len(done) < options.calls:
            rover.tidy()
            seen = page.evaluate("window.seen")
            card = page.locator(".open .call:not([data-stage=closed])").first
            if card.count():
                call = card.locator("h3").inner_text().split()[1].strip(":,")[1:]
                picture = seen.get(call, {}).get("picture")
                waits = card.locator("li[data-tone=wait]").count()
                late = time.time() - clicked.get(call, 0.0) > 20.0
                if picture and time.time() - picture > READS and late and not waits:
                    card.locator("button.go").click()
                    clicked.setdefault(call, time.time())
            done = {call for call, times in seen.items() if "driven_on" in times}
            time.sleep(0.2)
        page.screenshot(path=str(out / "end.png"), full_page=True)
        seen = page.evaluate("window.seen")
        rate = relay.up_bytes / max(1.0, time.monotonic() - began)
        found = _figures(seen, clicked, rover.folder / "state" / "calls")
        figures = {
            "baud": options.baud,
            "loss": round(relay.lost, 3),
            "bytes_a_second": round(rate),
            "driven_on": len(done),
            **found,
            "errors": errors,
            "out": str(out),
        }
    print(json.dumps(figures))
    return 0 if len(done) >= options.calls and not errors else 1


def _figures(seen: dict[str, Any], clicked: dict[str, float], records: Path) -> dict[str, Any]:
    """Return median and longest of each time, and how many calls it is of."""
    times: dict[str, list[float]] = {"shown": [], "picture": [], "acknowledged": []}
    for call, noted in seen.items():
        try:
            place = json.loads((records / f"{call}.json").read_text())["place"]
        except (OSError, ValueError, KeyError):
            continue
        for what in ("shown", "picture"):
            if what in noted:
                times[what].append(noted[what] - place["time"])
        if "acknowledged" in noted and call in clicked:
            times["acknowledged"].append(noted["acknowledged"] - clicked[call])
    return {what: _summary(all_) for what, all_ in times.items()} | {"calls": len(seen)}


def _summary(times: Sequence[float]) -> dict[str, float]:
    if not times:
        return {"calls": 0}
    return {"calls": len(times), "median": round(median(times), 2), "longest": round(max(times), 2)}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.console.radio", description=__doc__)
    parser.add_argument("--baud", type=int, default=57600)
    parser.add_argument("--loss", type=float, default=0.0, help="share of frames lost in each direction")
    parser.add_argument("--calls", type=int, default=6, help="calls to drive on from (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=140.0, help="at most (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="which trail, and what the radio loses")
    parser.add_argument("--out", help="folder for logs and a screenshot")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
