"""What the page makes of what it is told, run by Node.js where that is installed."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import companion.observers.page
import companion.pages

NODE = shutil.which("node")
FOLDERS = [Path(package.__path__[0], "static") for package in (companion.pages, companion.observers.page)]
pytestmark = pytest.mark.skipif(NODE is None, reason="Node.js is not installed")


def said(folder: Path, expression: str, **given: Any) -> Any:
    """What the expression is, which may use `model`, `place`, `Delay` and what is given."""
    assert NODE is not None
    (folder / "package.json").write_text('{"type": "module"}')
    for module in (file for static in FOLDERS for file in static.glob("*.js")):
        (folder / module.name).write_bytes(module.read_bytes())
    script = folder / "script.mjs"
    script.write_text(
        "import * as model from './model.js'; import { place } from './place.js';"
        " import { Delay } from './delay.js';"
        f" const {{{', '.join(given)}}} = {json.dumps(given)};\n"
        f"console.log(JSON.stringify({expression}));"
    )
    ran = subprocess.run([NODE, str(script)], capture_output=True, text=True, timeout=30.0, check=True)
    return json.loads(ran.stdout)


def test_a_companion_that_starts_is_said_nothing_of_that_is_not_known(tmp_path: Path) -> None:
    starting = {"state": "starting"}
    news = {"told": "", "status": starting, "state": starting, "check": starting}
    facts = dict(said(tmp_path, "model.facts(news)", news=news))
    assert facts.keys() == {"uncertainty", "similarity", "latency"}
    assert set(facts.values()) == {"not known"}


def test_a_companion_that_runs_says_what_is_open_and_what_runs(tmp_path: Path) -> None:
    news = {
        "status": {"policy": "hold", "held_by": None, "vision": {"trouble": "", "restarts": 0}, "link": {}},
        "state": {"open": None},
    }
    facts = dict(said(tmp_path, "model.facts(news)", news=news))
    assert facts["policy"] == "hold: it may hold the vehicle"
    assert facts["open"] == "no call, no hold"
    assert facts["held by"] == "nobody"
    assert facts["vision"] == "running"
    assert facts["link"] == "no autopilot is heard"


def test_in_policy_guide_it_says_whether_it_drives_and_what_it_lacks(tmp_path: Path) -> None:
    guide = {"state": "off", "lacks": "no ArduPilot rover"}
    facts = dict(said(tmp_path, "model.facts(news)", news={"status": {"policy": "guide", "guide": guide}}))
    assert facts["policy"] == "guide: it holds, and drives round what leaves room"
    assert facts["guide"] == "off: no ArduPilot rover"
    facts = dict(said(tmp_path, "model.facts(news)", news={"status": {"policy": "hold", "guide": guide}}))
    assert "guide" not in facts


@pytest.mark.parametrize("infrared", [True, False, None])
def test_a_camera_that_shows_infrared_is_said_and_no_other(tmp_path: Path, infrared: bool | None) -> None:
    news = {"status": {"camera": {"state": "delivering", "infrared": infrared}}}
    facts = dict(said(tmp_path, "model.facts(news)", news=news))
    assert facts["camera"] == ("delivering, shows infrared (NoIR)" if infrared else "delivering")


@pytest.mark.parametrize("age", [60.1, 1e9, None])
def test_checks_that_hang_are_not_said_to_be_well(tmp_path: Path, age: float | None) -> None:
    check = {"ok": True, "age": age, "checks": [{"check": "disk", "verdict": "pass", "text": "40 GiB"}]}
    shown = said(tmp_path, "model.checks({ check })", check=check)
    assert "more than a minute old" in shown["summary"]
    check["age"] = 12.0
    assert said(tmp_path, "model.checks({ check })", check=check)["summary"] == "All is well."


def test_computer_figures_that_are_not_measured_any_more_are_said_to_be_old(tmp_path: Path) -> None:
    hangs, works = {"age": 61.0, "checks": []}, {"age": 10.0, "checks": []}
    assert "measured" in dict(said(tmp_path, "model.computer({ check })", check=hangs))
    assert "measured" not in dict(said(tmp_path, "model.computer({ check })", check=works))


EACH = "const d = new Delay(); return events.map(([sent, now]) => d.late(sent, now));"


def late(folder: Path, events: list[tuple[float, float]]) -> list[float]:
    """Seconds that events waited. events: when each was sent by the rover's clock, and came by the other."""
    found = said(folder, f"(() => {{ {EACH} }})()", events=events)
    assert all(isinstance(one, int | float) for one in found)
    return [float(one) for one in found]


def test_events_that_a_slow_network_delays_are_as_old_as_they_are(tmp_path: Path) -> None:
    delayed = late(tmp_path, [(1000.0 + sent, 5.0 + 2.0 * sent) for sent in range(20)])
    assert delayed[0] == 0.0
    assert delayed[-1] == pytest.approx(19.0, abs=0.05)


def test_a_burst_after_a_gap_shows_only_its_newest_event_as_new(tmp_path: Path) -> None:
    burst = late(tmp_path, [(0.0, 50.0), *[(float(sent), 80.0) for sent in range(1, 31)]])
    assert burst[1] == pytest.approx(29.0, abs=0.1)
    assert burst[-1] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_clocks_that_part_slowly_do_not_look_like_a_delay(tmp_path: Path, drift: float) -> None:
    day = late(tmp_path, [(float(sent), 7.0 + sent * (1.0 + drift)) for sent in range(0, 86400, 10)])
    assert max(day) < 0.1


def test_news_that_were_late_are_no_news(tmp_path: Path) -> None:
    news = {"told": "", "status": {"state": "ok"}, "age": 0.1, "since": 5.0, "exact": True}
    shown = "model.overview({ ...news, receivedAt: 100 - late }, 100, '')"
    assert said(tmp_path, shown, news=news, late=0.0)["title"] == "OK"
    assert said(tmp_path, shown, news=news, late=3.0)["title"] == "NO NEWS"


def test_a_place_that_matched_is_shown_with_its_picture_its_words_and_how_to_refuse_it(
    tmp_path: Path,
) -> None:
    known = {
        "scene": 31,
        "call": 12,
        "similarity": 0.9999,
        "needed": 0.925,
        "since": None,
        "changed": {"gravel": [None, 1], "bush": [-0.5, -1], "mud": [-1, None]},
        "picture": "/calls/12.jpg",
    }
    place = said(tmp_path, "place(known)", known=known)
    assert place["title"] == "Known place: that of call 12"
    assert place["picture"] == "/calls/12-large.jpg"
    rows = dict(place["rows"])
    assert rows["similarity"] == "0.99, at least 0.93 is needed"
    assert rows["since"] == "not known"
    assert rows["changed"] == "gravel 1, bush -1 (was -0.5), mud out of use"
    assert "other place 12" in rows["wrong?"]


def test_a_place_without_a_call_keeps_its_own_picture(
    tmp_path: Path,
) -> None:
    known: dict[str, Any] = {
        "call": None,
        "similarity": 1,
        "needed": 0.9,
        "since": 1.0,
        "changed": {},
        "picture": "/scenes/ab.jpg",
    }
    place = said(tmp_path, "place(known)", known=known)
    assert (place["title"], place["picture"]) == ("Known place", "/scenes/ab.jpg")
    assert dict(place["rows"])["changed"] == "no word"
