"""A plot names its lines at the right, and its dots where they are."""

from __future__ import annotations

import re

from anytraverse.line_plot import Series, line_plot


def texts(drawn: str) -> dict[str, tuple[float, float]]:
    """Text -> where it stands, x and y."""
    found = re.findall(r'<text x="([\d.]+)" y="([\d.]+)"[^>]*>([^<]*)</text>', drawn)
    return {name: (float(x), float(y)) for x, y, name in found}


def test_a_dot_has_its_name_beside_it_and_a_line_at_the_right() -> None:
    series = [
        Series("left", "--red", [(0.1, 0.9)], dots=True),
        Series("right", "--green", [(0.95, 0.5)], dots=True),
        Series("line", "--blue", [(0.0, 0.0), (1.0, 0.2)]),
    ]
    drawn = line_plot(series, "share")
    places = texts(drawn)
    circles = re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)"', drawn)
    for name, (across, down) in zip(("left", "right"), circles, strict=True):
        assert abs(places[name][0] - float(across)) < 10
        assert abs(places[name][1] - float(down)) < 6
    assert places["left"][0] > float(circles[0][0])
    assert places["right"][0] < float(circles[1][0])
    assert places["line"][0] > max(float(across) for across, _ in circles)


def test_names_of_dots_in_one_place_do_not_overlap() -> None:
    dots = [Series(name, "--red", [(1.0, 0.0)], dots=True) for name in ("now", "proposed")]
    places = texts(line_plot(dots, "calls"))
    assert abs(places["now"][1] - places["proposed"][1]) >= 12
    assert max(down for _, down in places.values()) < 330
