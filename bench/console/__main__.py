"""Answers a simulated rover's calls in a real browser: `python -m bench.console`.

It needs Playwright and Chromium. It starts the simulated field, the daemon and the console, answers the
calls as a person would, with mouse and keyboard, and counts actions. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any

from bench.console.stage import CHROMIUM, Rover, start_console
from companion.sim.demo.answers import GROUND, WORDS_FOR_PLACE

READS = 2.5
"""Seconds for which a person reads a call."""
CALL = ".open .call:not([data-stage=closed])"


class Person:
    """Looks at the page and answers. Each click, key press of a command or typed name is one action."""

    def __init__(self, page: Any, rover: Rover, out: Path) -> None:
        self._page = page
        self._rover = rover
        self._out = out
        self.actions: defaultdict[str, list[int]] = defaultdict(list)
        self.told: list[str] = []
        self._since: dict[str, float] = {}
        self._tries: defaultdict[str, int] = defaultdict(int)

    def look(self) -> None:
        """Answer the call that is open, if one is; take a named thing away that keeps the rover standing."""
        self._rover.tidy()
        card = self._page.locator(CALL).first
        if not card.count():
            return
        name = card.locator("h3").inner_text().split()[1].strip(":,")
        stage = card.get_attribute("data-stage")
        key = f"{name}/{stage}"
        if self._tries[key] >= 4 or card.locator("li[data-tone=wait]").count():
            return
        reason = card.locator(".reason").inner_text()
        thing = self._rover.thing_ahead()
        if stage == "answered" or (name.startswith("H") and thing):
            return
        if self._since.setdefault(key, time.monotonic()) > time.monotonic() - READS:
            return
        self._tries[key] += 1
        if stage == "clear" or name.startswith("H") or self._tries[key] > 2:
            self._go(card)
        elif "new place" in reason or "unlike" in reason:
            self._name_place(card)
        else:
            self._name_thing(card, thing or GROUND[self._rover.zone()], -1 if thing else 1)
        self._page.screenshot(
            path=str(self._out / f"{key.replace('/', '-')}-{self._tries[key]}.png"), full_page=True
        )
        time.sleep(1.0)

    def _go(self, card: Any) -> None:
        card.locator("button.go").click()
        self.actions["go"].append(1)

    def _name_place(self, card: Any) -> None:
        word, _, weight = WORDS_FOR_PLACE[self._rover.zone()].split(";")[0].partition(":")
        card.get_by_label("Its name").fill(word)
        card.get_by_label("Weight", exact=True).fill(weight.strip())
        card.locator("button.go").click()
        self.actions["name a place"].append(3)

    def _name_thing(self, card: Any, word: str, weight: int) -> None:
        card.get_by_label("Its name").fill("")
        frame = card.locator(".shot.small .aim").bounding_box()
        tile = card.locator(".shot.small svg rect.tile, .shot.small svg rect.own").first
        x, y, width, height = (
            float(tile.get_attribute(side)) / 100 for side in ("x", "y", "width", "height")
        )
        self._page.mouse.click(
            frame["x"] + frame["width"] * (x + width / 2), frame["y"] + frame["height"] * (y + height / 2)
        )
        card.locator("svg rect.own").first.wait_for(state="attached")
        card.get_by_label("Its name").fill(word)
        actions = 3
        if weight != -1:
            card.get_by_label("Weight", exact=True).fill(str(weight))
            actions += 1
        card.get_by_label("Its name").press("Enter")
        self.actions["tap and name"].append(actions)


def main() -> int:
    """Play until enough calls were answered and driven on from, or the time is over."""
    options = _options()
    from playwright.sync_api import sync_playwright

    out = Path(options.out or tempfile.mkdtemp(prefix="console-"))
    out.mkdir(parents=True, exist_ok=True)
    errors: list[str] = []
    with ExitStack() as stack, sync_playwright() as play:
        rover = Rover(out / "rover", options.seed)
        stack.callback(rover.close)
        console, url = start_console([rover.link], out)
        stack.callback(console.stop)
        page = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]).new_page(
            viewport={"width": 1280, "height": 900}
        )
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.extend([said.text] if said.type == "error" else []))
        page.goto(url)
        rover.drive()
        person = Person(page, rover, out)
        began = time.monotonic()
        driven_on = 0
        while time.monotonic() - began < options.seconds and driven_on < options.calls:
            person.look()
            driven_on = page.locator(".becoming li", has_text="The rover drives on").count()
            time.sleep(0.3)
        page.screenshot(path=str(out / "end.png"), full_page=True)
        said = page.locator(".becoming").all_inner_texts()
    figures = {
        "seconds": round(time.monotonic() - began, 1),
        "driven_on": driven_on,
        "actions": {
            kind: {"calls": len(all_), "median": median(all_)} for kind, all_ in person.actions.items()
        },
        "errors": errors,
        "out": str(out),
    }
    print("\n".join(said))
    print(json.dumps(figures))
    return 0 if driven_on >= options.calls and not errors else 1


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.console", description=__doc__)
    parser.add_argument("--calls", type=int, default=3, help="calls to drive on from (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=150.0, help="at most (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="which trail")
    parser.add_argument("--out", help="folder for screenshots")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
