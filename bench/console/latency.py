"""Measures how soon the page shows a call: `python -m bench.console.latency`, with Playwright and Chromium.

A call's data leave by UDP on the loopback; the time until its card stands in the page is taken in the
browser, by the same clock. It also sums the bytes of the page. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import socket
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from statistics import quantiles
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from bench.console.stage import CHROMIUM, start_console
from companion.wire import ids
from companion.wire.call_report import CallReport

_WATCH = """
window.seen = {};
new MutationObserver(() => {
  for (const title of document.querySelectorAll(".open .call h3")) {
    const found = /C(\\d+)/.exec(title.textContent);
    if (found) window.seen[found[1]] ??= Date.now();
  }
}).observe(document.body, { childList: true, subtree: true, characterData: true });
"""
_GAP = 0.35


def main() -> int:
    """Send calls, and print how long each took."""
    parser = argparse.ArgumentParser(prog="python -m bench.console.latency", description=__doc__)
    parser.add_argument("--calls", type=int, default=100)
    calls = parser.parse_args().calls
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        console, url = start_console(["udpin:127.0.0.1:0"], Path(folder))
        try:
            link = console.first_line(10.0).split()[3].rstrip(",.")
            page = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]).new_page()
            loaded: list[str] = []
            page.on("response", lambda answer: loaded.append(answer.url))
            page.goto(url)
            page.locator("#nobody-why", has_text="Listening on").wait_for()
            paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0]?.startTime")
            page.evaluate(_WATCH)
            sent = _send(link, calls)
            time.sleep(1.0)
            seen = page.evaluate("window.seen")
            size = sum(len(urllib.request.urlopen(one).read()) for one in loaded if "/events" not in one)
        finally:
            console.stop()
    taken = sorted(seen[str(number)] - at for number, at in sent.items() if str(number) in seen)
    found: dict[str, Any] = {
        "sent": len(sent),
        "shown": len(taken),
        "ms": {"p50": taken[len(taken) // 2], "p99": quantiles(taken, n=100)[98], "max": taken[-1]},
        "page_bytes": size,
        "first_paint_ms": paint and round(paint),
    }
    print(json.dumps(found))
    return 0 if len(taken) == len(sent) else 1


def _send(link: str, calls: int) -> dict[int, float]:
    """Announce and close calls. Returns when each was announced, in ms since 1970."""
    air = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    air.connect(("127.0.0.1", int(link.rsplit(":", 1)[1])))
    encoder = mavlink.MAVLink(None, srcSystem=1, srcComponent=ids.COMPONENT_ID)
    sent = {}

    def say(call: CallReport) -> None:
        current = call.id if call.stage is ids.Stage.OPEN else 0
        mode = ids.heartbeat_mode(ids.State.CALLING if current else ids.State.OK, current, ids.Policy.HOLD)
        payload = call.pack()
        for message in (
            mavlink.MAVLink_heartbeat_message(18, 8, 0, mode, 4, 3),
            mavlink.MAVLink_tunnel_message(0, 0, ids.TUNNEL_CALL, len(payload), payload.ljust(128, b"\0")),
        ):
            air.send(message.pack(encoder))
            encoder.seq = (encoder.seq + 1) % 256

    for number in range(1, calls + 1):
        sent[number] = 1e3 * time.time()
        say(call_of(number, ids.Stage.OPEN))
        time.sleep(_GAP)
        say(call_of(number, ids.Stage.CLOSED))
        time.sleep(_GAP + number % 7 * 0.011)  # at any time of the console's own cycle
    return sent


def call_of(number: int, stage: ids.Stage) -> CallReport:
    """Return a call about an unknown object."""
    closed = stage is ids.Stage.CLOSED
    return CallReport(
        id=number,
        kind=ids.Kind.CALL,
        stage=stage,
        outcome=ids.Outcome.PASSED if closed else ids.Outcome.NONE,
        reasons=ids.Reasons.UNKNOWN_OBJECT,
        holding=not closed,
        test=False,
        frame_id=number,
        age_s=0,
        roi=(0.3, 0.5, 0.7, 0.95),
        worst_tile_box=(0.41, 0.55, 0.6, 0.81),
        roi_uncertainty=0.38,
        worst_tile=0.71,
        drivable_share=0.9,
        similarity=0.97,
        latitude=None,
        longitude=None,
        heading=None,
        word_count=2,
        words=1234,
    )


if __name__ == "__main__":
    sys.exit(main())
