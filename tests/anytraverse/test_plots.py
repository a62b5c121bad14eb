"""A plot says what it shows and how many frames are behind it, and a page of plots needs no network."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest

from anytraverse import plots
from anytraverse.plots import Axis, Curve, Plot, curves, drawing, section, svg

LINES = [
    Curve(
        "mean </script> IoU",
        "--green",
        [{"x": 0.1, "y": 0.5, "frames": 7}, {"x": 0.2, "y": 0.4, "frames": 6}],
    ),
    Curve("recall", "--red", [{"x": 0.1, "y": 0.9, "low": 0.8, "high": 1.0, "frames": 7}]),
]


def plot() -> Plot:
    across = Axis("traversability above which a pixel counts as drivable", (0.0, 1.0))
    return curves("A title", "Of 7 frames.", LINES, across, Axis("share, 0 to 1"), mark=("in use", 0.5))


def layers(made: Plot, kind: str) -> list[dict[str, Any]]:
    return [one for one in made.spec["layer"] if one["mark"]["type"] == kind]


def test_every_axis_has_a_title_that_a_phone_has_room_for() -> None:
    for layer in layers(plot(), "line"):
        for axis in ("x", "y"):
            title = layer["encoding"][axis]["title"]
            assert title
            assert max(map(len, title)) <= 40
    assert layers(plot(), "line")[0]["encoding"]["x"]["title"] == [
        "traversability above which a pixel",
        "counts as drivable",
    ]


def test_a_hover_tells_the_line_its_figures_and_the_frames_behind_them() -> None:
    (hover,) = (one for one in plot().spec["layer"] if one["mark"].get("opacity") == 0)
    told = [one["field"] for one in hover["encoding"]["tooltip"]]
    assert told == ["line", "x", "y", "frames"]
    assert {row["frames"] for row in plot().spec["data"]["values"]} == {6, 7}
    (zoom,) = hover["params"]
    assert zoom["bind"] == "scales"


def test_points_at_the_ends_of_an_axis_are_whole() -> None:
    low, high = layers(plot(), "line")[0]["encoding"]["x"]["scale"]["domain"]
    assert low < 0.0
    assert high > 1.0


def test_the_value_in_use_and_the_spread_are_drawn() -> None:
    mark, spread = layers(plot(), "rule")
    assert mark["data"]["values"] == [{"at": 0.5, "what": "in use"}]
    assert (spread["encoding"]["y"]["field"], spread["encoding"]["y2"]["field"]) == ("low", "high")


def test_no_name_ends_the_script_that_holds_it() -> None:
    html = section(plot(), "here")
    assert html.count("</script>") == 1
    (data,) = re.findall(r'<script type="application/json">(.*)</script>', html)
    assert json.loads(data) == plot().spec


def test_without_the_library_the_page_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plots, "installed", lambda: False)
    assert "install the extra plots" in section(plot())
    assert list(drawing()) == []


def test_the_library_is_in_the_page_and_asks_for_nothing() -> None:
    pytest.importorskip("vl_convert")
    library, draw = drawing()
    assert library.startswith("<script>")
    assert len(library) > 500_000
    assert library.count("</script>") == 1
    assert "vegaEmbed" in draw


def test_a_picture_has_its_title_and_no_colour_of_a_page_and_is_the_same_each_time() -> None:
    pytest.importorskip("vl_convert")
    drawn = svg(plot(), 400, 200)
    assert drawn.startswith("<svg ")
    assert "A title" in drawn
    assert "var(" not in drawn
    assert drawn == svg(plot(), 400, 200)


def test_of_what_is_counted_nothing_between_whole_numbers_is_labelled() -> None:
    pytest.importorskip("vl_convert")
    line = Curve("calls", "--green", [{"x": 0, "y": 0}, {"x": 4, "y": 1}])
    drawn = svg(curves("A title", "", [line], Axis("frame", (0, 4)), Axis("calls", whole=True)), 600, 300)
    assert re.findall(r'text-anchor="end"[^>]*>([^<]+)<', drawn) == ["0", "1"]
