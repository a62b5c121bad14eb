"""Texts in words, as CLIP splits them, on every version of Python."""

from __future__ import annotations

import pytest

from anytraverse.perception.clipseg.pretokenizer import words
from anytraverse.perception.clipseg.unicode_tables import composed, lowered, shape


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("A photo of Dry-Grass", ["a", "photo", "of", "dry", "-", "grass"]),
        ("it's we'll they'D rock'n", ["it", "'s", "we", "'ll", "they", "'d", "rock", "'", "n"]),
        ("200m²", ["2", "0", "0", "m", "²"]),
        ("草地 путь", ["草地", "путь"]),
        ("¿¡mud!?", ["¿¡", "mud", "!?"]),
        ("a\x1cb\x85c\u200bd\u3000e", ["a", "\x1c", "b", "c", "\u200b", "d", "e"]),
        ("<|ENDOFTEXT|>!!", ["<|", "endoftext", "|>", "!!"]),
        ("!<|ENDOFTEXT|>!!", ["!<|", "endoftext", "|>!!"]),
        ("", []),
    ],
)
def test_a_text_splits_as_clip_splits_it(text: str, expected: list[str]) -> None:
    assert list(words(text)) == expected


def test_lower_case_is_character_by_character_without_a_final_sigma() -> None:
    assert lowered("ΟΔΟΣ") == "οδοσ"
    assert lowered("İSTANBUL") == "i̇stanbul"


def test_capitals_newer_than_python_3_10_have_small_letters() -> None:
    capitals = "\ua7c0\ua7d0\ua7dc\U00010570\U00010d50\U00016ea0"
    assert lowered(capitals) == "\ua7c1\ua7d1\u019b\U00010597\U00010d70\U00016ebb"


def test_accents_are_composed_but_no_mark_newer_than_unicode_9_moves() -> None:
    assert composed("e\u0301") == "é"
    assert composed("q\u0301\u0327") == "q\u0327\u0301"
    assert composed("q\u0897\u0327") == "q\u0897\u0327"
    assert composed("\U00011935\U00011930") == "\U00011935\U00011930"


def test_letters_and_numbers_newer_than_python_3_10_keep_their_class() -> None:
    assert shape("\u0870\u0887\u0378 \U000323af\U0001fffe") == "zz! z!"
    assert shape("\U00010d40\U00010d49\U0001e5fa") == "000"
