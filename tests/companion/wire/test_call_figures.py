"""How the figures for which a call asks are worded, and read back from its text."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.wire import texts
from companion.wire.call_figures import asked, place_figures, thing_figures
from companion.wire.ids import MAX_TEXT

FIGURE = st.none() | st.floats()
IDS = st.integers(1, 0xFFFF)
PARTS = st.sampled_from(["yellow frame", "region", ""])
LIGHT = st.sampled_from(["", "dark", "low sun or haze"])
LIKE = st.none() | st.integers(0, 0xFFFF)


def said(call: int, words: str, made: Callable[..., str], *figures: object) -> None:
    """The text fits a STATUSTEXT, and what it says of the figures is read back."""
    text = made(call, *figures)
    assert len(text.encode()) <= MAX_TEXT
    read = asked(text)
    if read is None:
        assert words == "unknown thing ahead"
        return
    assert read[0] == call
    assert "/word" not in read[1]
    assert read[1] in text


@given(call=IDS, share=FIGURE, limit=FIGURE, of=PARTS, light=LIGHT)
def test_a_thing_is_told_in_50_bytes_whatever_its_figures(
    call: int, share: float | None, limit: float | None, of: str, light: str
) -> None:
    words = thing_figures(share, limit, of, light)
    said(call, words, texts.unknown_object, share, limit, of, light)
    said(call, words, texts.unknown_both, share, limit)
    said(call, words, texts.still_unknown, share, limit)


@given(call=IDS, similarity=FIGURE, needed=FIGURE, like=LIKE, light=LIGHT)
def test_a_place_is_told_in_50_bytes_whatever_its_figures(
    call: int, similarity: float | None, needed: float | None, like: int | None, light: str
) -> None:
    words = place_figures(similarity, needed, like, light)
    said(call, words, texts.unknown_scene, similarity, needed, like, light)
    said(call, words, texts.still_new, similarity, needed)


@given(similarity=st.floats(-1, 1), lacks=st.floats(1e-5, 1), like=LIKE)
def test_what_a_place_needs_is_told_as_more_than_it_has(
    similarity: float, lacks: float, like: int | None
) -> None:
    if similarity + lacks > 1.0:
        return
    told = place_figures(similarity, similarity + lacks, like)
    value, needed = re.findall(r"-?[01]?\.[0-9]{2}", told)
    assert float(value) < float(needed)


@given(limit=st.floats(0, 0.99), more=st.floats(1e-5, 1))
def test_what_calls_is_told_as_less_than_a_thing_has(limit: float, more: float) -> None:
    told = thing_figures(min(1.0, limit + more), limit, "yellow frame")
    share, over = map(int, re.findall(r"[0-9]+(?=%)", told))
    assert over < share


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("C8 new place, .91 like C3, .94 needed: go/word", (8, "new place, .91 like C3, .94 needed")),
        ("C8 new place, dark, .91, .94 needed: go/word", (8, "new place, dark, .91, .94 needed")),
        (
            "C7 unknown 91% in yellow frame, over 85% calls",
            (7, "unknown 91% in yellow frame, over 85% calls"),
        ),
        ("C7 stays open: unknown 34%, over 25% calls", (7, "unknown 34%, over 25% calls")),
        ("C7 clear now, go?", None),
        ("C7 closed: accepted this once", None),
        ("C7 unknown thing ahead 38%: go/stay/word", None),
        ("H7 new place, .91 like C3, .94 needed: go/word", None),
        ("C7 TEST call, nothing is wrong: go/stay/word", None),
        ("C٣ new place: go/stay/word", None),
        ("C7 new place\x1b[2J: go/stay/word", None),
        ("", None),
    ],
)
def test_the_text_of_a_call_is_read_and_no_other(text: str, found: tuple[int, str] | None) -> None:
    assert asked(text) == found
