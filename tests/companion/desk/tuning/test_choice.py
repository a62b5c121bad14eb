"""One plot shows all settings to choose from, with what each costs and what it notices."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from anytraverse.regions import Box
from companion.desk.tuning.choice import Choice, OfferedSetting, choice_plot, frontier, parts
from companion.desk.tuning.things import LabelledThing, noticed
from companion.desk.tuning.trial import Combination, TrialOutcome

REGION = Box(0.3, 0.5, 0.7, 0.9)


def setting(number: int, calls: float, things: int, roi: float = 0.3, **more: Any) -> OfferedSetting:
    return OfferedSetting(
        number, Combination(0.9, roi, None, REGION), calls, things, f"roi = {roi}\n", **more
    )


SETTINGS = [
    setting(0, 1.0, 1),
    setting(1, 1.0, 1, 0.4),
    setting(2, 2.0, 3, 0.2, warnings=["WARNING: <less>"]),
    setting(3, 4.0, 3),
    setting(4, 4.0, 2),
]
CHOICE = Choice(
    SETTINGS,
    3,
    2,
    "calls a minute",
    "things noticed",
    "96 frames, 32 s",
    "tune --take {} --from {b}",
    most=3,
    wanted=2.5,
)
POINTS = st.lists(st.tuples(st.floats(0, 20), st.integers(0, 5)), min_size=1)


def points() -> dict[int, dict[str, Any]]:
    return {row["number"]: row for row in choice_plot(CHOICE).spec["data"]["values"]}


def test_a_point_stands_for_all_settings_of_its_outcome() -> None:
    assert sorted(points()) == [0, 2, 3, 4]
    assert points()[0]["settings with this outcome"] == 2


def test_the_proposal_and_what_is_in_force_are_marked_and_drawn_last() -> None:
    roles = [row["role"] for row in choice_plot(CHOICE).spec["data"]["values"]]
    assert roles == ["a setting", "none notices more", "in force now", "proposed"]
    assert points()[2]["role"] == "proposed"
    assert points()[3]["role"] == "in force now"


def test_a_hover_gives_the_settings_and_the_frames() -> None:
    plot = choice_plot(CHOICE)
    (dots,) = (one for one in plot.spec["layer"] if "tooltip" in one["encoding"] and "params" in one)
    told = [one["field"] for one in dots["encoding"]["tooltip"]]
    assert told[:4] == ["number", "role", "x", "y"]
    assert {"scene", "roi", "tile", "region", "frames behind it"} <= set(told)
    assert points()[0]["tile"] == "off"
    assert points()[0]["region"] == "0.3 0.5 0.7 0.9"
    assert points()[0]["frames behind it"] == "96 frames, 32 s"


def test_titles_say_what_is_counted_and_the_note_of_how_much() -> None:
    plot = choice_plot(CHOICE)
    assert plot.title == "Calls a minute against things noticed"
    assert plot.note.startswith("96 frames, 32 s, 5 settings.")
    wanted = plot.spec["layer"][0]
    assert wanted["data"]["values"] == [{"at": 2.5, "what": "wanted at most"}]


def test_what_is_counted_has_no_ticks_between_whole_numbers() -> None:
    def ticks(calls: float) -> list[dict[str, object]]:
        spec = choice_plot(replace(CHOICE, settings=[setting(0, calls, 3)], now=None, proposed=None)).spec
        (dots,) = (
            one["encoding"] for one in spec["layer"] if "tooltip" in one["encoding"] and "params" in one
        )
        return [dots[side].get("axis", {}) for side in ("x", "y")]

    assert [one["tickMinStep"] for one in ticks(2)] == [1, 1]
    assert [one.get("tickMinStep") for one in ticks(2.0)] == [None, 1]


def test_the_page_begins_with_the_proposal_and_can_show_each_other_point() -> None:
    page = "".join(parts(CHOICE))
    assert '<option value="2" selected>2: calls a minute 2, things noticed 3 of 3, proposed</option>' in page
    assert "roi = 0.2\n</pre>" in page
    assert "tune --take 2 --from {b}</pre>" in page
    assert "WARNING: &lt;less&gt;" in page
    (data,) = re.findall(r'<script id="settings" type="application/json">(.*?)</script>', page)
    told = json.loads(data)
    assert sorted(told) == ["0", "2", "3", "4"]
    assert told["4"]["command"] == "tune --take 4 --from {b}"
    assert told["2"]["warnings"] == ["WARNING: <less>"]


@given(POINTS)
def test_no_setting_calls_less_and_notices_as_much_as_one_of_the_frontier(
    found: list[tuple[float, int]],
) -> None:
    settings = [setting(number, *one) for number, one in enumerate(found)]
    line = frontier(settings)
    for one in line:
        assert not any(other.calls < one.calls and other.noticed >= one.noticed for other in settings)
    assert max(one.noticed for one in settings) == line[-1].noticed


def test_a_thing_is_noticed_where_a_rover_stood_while_it_was_there_or_just_after() -> None:
    outcome = TrialOutcome(Combination(0.9, 0.3, None, REGION))
    for frame in (3, 4, 5, 9, 20):
        outcome.stands(frame)
    assert outcome.stood == [(3, 5), (9, 9), (20, 20)]
    things = [LabelledThing("drum", *run) for run in ((0, 3), (5, 6), (7, 8), (10, 16), (18, 19))]
    assert noticed(things, outcome.stood) == 4
    assert noticed(things[3:4], outcome.stood) == 0
