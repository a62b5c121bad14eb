"""What a call's text tells of its figures is worded for pages with the same numbers."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from companion.wire.call_figures import place_figures, place_in_words, thing_figures, thing_in_words

SHARES = st.floats(0.0, 1.0)
LIGHTS = st.sampled_from(["", "dark", "low sun or haze"])


@given(SHARES, SHARES, st.sampled_from(["yellow frame", "region", ""]), LIGHTS)
def test_a_thing_is_told_with_its_share_and_the_limit(
    share: float, limit: float, of: str, light: str
) -> None:
    text = thing_figures(share, limit, of, light)
    told = thing_in_words(text)
    assert re.findall(r"\d+", told) == re.findall(r"\d+", text)
    assert light in told
    assert light or of in told


@given(SHARES, SHARES, st.sampled_from([None, 0, 3, 65535]), LIGHTS)
def test_a_place_is_told_with_what_it_is_like_and_what_is_needed(
    similarity: float, needed: float, like: int | None, light: str
) -> None:
    text = place_figures(similarity, needed, like, light)
    told = place_in_words(text)
    assert [float(one) for one in re.findall(r"\d?\.\d\d", told)] == [
        float(one) for one in re.findall(r"\d?\.\d\d", text)
    ]
    assert light in told
    assert light or not like or f"like C{like}," in told


@given(st.text(max_size=60))
def test_any_other_text_is_worded_as_nothing_or_as_its_own_figures(text: str) -> None:
    assert thing_in_words(text) == "" or "unknown" in text
    assert place_in_words(text) == "" or "new place" in text


def test_both_are_found_in_what_tells_of_both() -> None:
    why = "new place, .91 like C3, .94 needed; unknown 71% in yellow frame, over 25% calls"
    assert thing_in_words(why) == "71 % of the yellow frame is unknown, over 25 % calls"
    assert place_in_words(why) == "0.91 like C3, known from 0.94 on"
    assert (thing_in_words("no room"), place_in_words("new place")) == ("", "")


def test_a_place_without_a_figure_keeps_its_light() -> None:
    assert place_in_words(place_figures(None, None, None, "dark")) == "dark"
    assert place_in_words("new place, low sun or haze; unknown 71%, over 25% calls") == "low sun or haze"
