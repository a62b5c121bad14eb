"""Answers a simulated rover's calls in a real browser: `python -m bench.console`.

It needs Playwright and Chromium. It starts the simulated field, the daemon and the console, answers the
calls as a person would, with mouse and keyboard, and counts actions. With --rover-page it answers on the
rover's own page instead. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import zipfile
from collections import defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any

from bench.console.stage import CHROMIUM, Rover, start_console
from companion.sim.demo.answers import WORDS_FOR_PLACE

READS = 2.5
"""Seconds for which a person reads a call."""
_GROUND = {"meadow": "grass", "forest": "dirt path", "gravel": "dry grass"}
"""The name of the ground where a call was needless."""
KINDS = ("go", "stay", "look again", "tap and name")
CALL = ".open .call:not([data-stage=closed])"
_COUNT = """
window.actions = 0;
let typing = false;
const count = (typed) => { if (!(typed && typing)) window.actions++; typing = typed; };
addEventListener("pointerdown", () => count(false), true);
const types = (event) => event.key.length === 1 && event.target.matches("input[type=text]");
addEventListener("keydown", (event) => count(types(event)), true);
"""
"""Counts in the page: a click, a key and a name that is typed are one action each."""


class Person:
    """Looks at the page and answers by mouse and keyboard. actions: counted in the page, by kind."""

    def __init__(
        self, page: Any, rover: Rover, out: Path, each: int, kinds: Sequence[str], picture: str | None = None
    ) -> None:
        """each: how many calls it answers with look again and stay before it answers them otherwise.

        kinds: of `KINDS`, those that it gives; without "tap and name" it says go to everything. picture: file
        for a picture of the first call that shows all there is.
        """
        self._page = page
        self._rover = rover
        self._out = out
        self._each = each
        self._kinds = kinds
        self._picture = picture
        self.actions: defaultdict[str, list[int]] = defaultdict(list)
        self._since: dict[str, float] = {}
        self._tries: defaultdict[str, int] = defaultdict(int)
        self._said: set[tuple[str, str]] = set()

    def look(self) -> None:
        """Answer the call that is open, if one is; take a named thing away that keeps the rover standing."""
        self._rover.tidy()
        card = self._page.locator(CALL).first
        if not card.count():
            return
        name = card.locator("h2, h3").first.inner_text().split()[1].strip(":,")
        stage = card.get_attribute("data-stage")
        key = f"{name}/{stage}"
        if self._tries[key] >= 6 or card.locator("li[data-tone=wait]").count():
            return
        thing = self._rover.thing_ahead()
        named = {(name, "tap and name"), (name, "name a place")} & self._said
        if (stage == "answered" and named) or (name.startswith("H") and thing):
            return
        if self._since.setdefault(key, time.monotonic()) > time.monotonic() - READS:
            return
        self._tries[key] += 1
        if self._picture and card.locator(".near img").count() and card.locator(".fade:visible").count():
            self._page.screenshot(path=self._picture, type="jpeg", quality=85)
            self._picture = None
        before = self._page.evaluate("window.actions")
        kind = self._answer(card, name, stage, thing)
        self.actions[kind].append(self._page.evaluate("window.actions") - before)
        self._said.add((name, kind))
        self._page.screenshot(
            path=str(self._out / f"{key.replace('/', '-')}-{self._tries[key]}.png"), full_page=True
        )
        time.sleep(1.0)

    def _answer(self, card: Any, name: str, stage: str, thing: str | None) -> str:
        """Give the answer that is next. Returns its kind."""
        reason = card.locator(".reason").inner_text()
        if name.startswith("C"):
            for kind, button in (("look again", "Look again"), ("stay", "Stay")):
                wanted = kind in self._kinds and len(self.actions[kind]) < self._each
                if wanted and (name, kind) not in self._said:
                    card.get_by_role("button", name=button).click()
                    return kind
        in_turn = self._each > 0 and len(self.actions["go"]) < len(self.actions["tap and name"])
        only_go = "tap and name" not in self._kinds or name.startswith("H") or in_turn
        if only_go or stage == "clear" or self._tries[f"{name}/{stage}"] > 4:
            card.locator("button.go").click()
            return "go"
        if "new place" in reason or "unlike" in reason:
            word, _, weight = WORDS_FOR_PLACE[self._rover.zone()].split(";")[0].partition(":")
            self._name(card, word, float(weight))
            return "name a place"
        tile = card.locator(".shot.small svg rect.tile, .shot.small svg rect.own").first
        sides = [float(tile.get_attribute(side)) / 100 for side in ("x", "y", "width", "height")]
        frame = card.locator(".shot.small .aim").bounding_box()
        self._page.mouse.click(
            frame["x"] + frame["width"] * (sides[0] + sides[2] / 2),
            frame["y"] + frame["height"] * (sides[1] + sides[3] / 2),
        )
        card.locator("svg rect.own").first.wait_for(state="attached")
        self._name(card, thing or _GROUND[self._rover.zone()], -1.0 if thing else 1.0)
        return "tap and name"

    def _name(self, card: Any, word: str, weight: float) -> None:
        """Choose the name if it was used before, else type it; then send it with go."""
        used = card.locator(".chips button").get_by_text(word, exact=True)
        if used.count():
            used.first.click()
        else:
            card.get_by_label("Its name").click()
            self._page.keyboard.type(word)
        slider = card.get_by_label("Weight", exact=True)
        if float(slider.input_value()) != weight:
            where = slider.bounding_box()
            share = 0.5 + weight / 2
            self._page.mouse.click(
                where["x"] + max(1.0, min(share * where["width"], where["width"] - 1.0)),
                where["y"] + where["height"] / 2,
            )
            card.locator("button.go").click()
        else:
            self._page.keyboard.press("Enter")


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
        url = ""
        if not options.rover_page:
            console, url = start_console([rover.link], out)
            stack.callback(console.stop)
        page = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]).new_page(
            viewport={"width": 1280, "height": 900}
        )
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.extend([said.text] if said.type == "error" else []))
        page.add_init_script(_COUNT)
        page.goto(url or rover.page())
        rover.drive()
        person = Person(page, rover, out, options.each, options.kinds, options.picture)
        began = time.monotonic()
        driven_on = 0
        seconds = options.seconds or _limit(options.calls, options.each * len(options.kinds))
        while time.monotonic() - began < seconds and (
            driven_on < options.calls
            or any(len(person.actions[kind]) < options.each for kind in options.kinds)
        ):
            person.look()
            # The console says that it drives on; the rover's own page puts the call behind.
            drove = page.locator(".becoming li", has_text="The rover drives on").count()
            closed = page.locator(".call[data-stage=closed]", has_text="answered").count()
            driven_on = max(driven_on, closed if options.rover_page else drove)
            time.sleep(0.3)
        page.screenshot(path=str(out / "end.png"), full_page=True)
        saved = 0 if options.rover_page else _save(page)
        said = page.locator(".becoming").all_inner_texts()
    figures = {
        "seconds": round(time.monotonic() - began, 1),
        "driven_on": driven_on,
        "actions": {
            kind: {"calls": len(all_), "median": median(all_)}
            for kind, all_ in person.actions.items()
            if all_
        },
        "calls_in_the_report": saved,
        "script_holds": rover.script_holds,
        "errors": errors,
        "out": str(out),
    }
    print("\n".join(said))
    print(json.dumps(figures))
    enough = all(len(person.actions[kind]) >= options.each for kind in options.kinds)
    done = driven_on >= options.calls and enough and (saved or options.rover_page)
    return 0 if done and not errors else 1


def _save(page: Any) -> int:
    """Save all calls as one report. Returns how many are in it."""
    with page.expect_download() as saving:
        page.get_by_role("link", name="Save all calls as one report").click()
    with zipfile.ZipFile(saving.value.path()) as report:
        return sum(name.endswith("data.json") for name in report.namelist())


def _limit(calls: int, answers: int) -> float:
    """Return the seconds that so many calls to drive on from, or so many answers, may take."""
    return 60.0 + max(30.0 * calls, 20.0 * answers)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.console", description=__doc__)
    parser.add_argument("--calls", type=int, default=3, help="calls to drive on from (default %(default)s)")
    parser.add_argument("--each", type=int, default=0, help="answers of each kind (default %(default)s)")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="answers that it gives")
    parser.add_argument(
        "--seconds", type=float, help="at most; by default what so many calls and answers may take"
    )
    parser.add_argument("--seed", type=int, default=0, help="which trail")
    parser.add_argument("--rover-page", action="store_true", help="answer on the rover's own page")
    parser.add_argument("--picture", metavar="FILE.jpg", help="a picture of a call goes there")
    parser.add_argument("--out", help="folder for screenshots")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
