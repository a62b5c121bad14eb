"""Composes, lowers and classifies characters as the libraries of transformers' tokenizers do.

These follow Unicode 9 for composing, 17 for lower case and 16 for letters and numbers. Python follows Unicode
13 (Python 3.10) or a newer one. The tables here make up for the difference up to Python 3.13; they were found
by comparing all code points. A newer Python also composes letters of Unicode 16, and knows later letters.
"""

from __future__ import annotations

import re
import unicodedata
from bisect import bisect_right


def _ranges(text: str) -> list[tuple[int, int]]:
    """Read inclusive ranges of code points, written in hexadecimal as "first-last" or "one"."""
    return [(int(item.split("-")[0], 16), int(item.split("-")[-1], 16)) for item in text.split()]


_NEWER_LETTERS = _ranges(
    "870-887 889-88e 8b5 8c8-8c9 c5d cdd 170d 171f 1b4c 1c89-1c8a 2c2f 2c5f 9ffd-9fff a7c0-a7c1 a7cb-a7cd "
    "a7d0-a7d1 a7d3 a7d5-a7dc a7f2-a7f4 10570-1057a 1057c-1058a 1058c-10592 10594-10595 10597-105a1 "
    "105a3-105b1 105b3-105b9 105bb-105bc 105c0-105f3 10780-10785 10787-107b0 107b2-107ba 10d4a-10d65 "
    "10d6f-10d85 10ec2-10ec4 10f70-10f81 11071-11072 11075 1123f-11240 11380-11389 1138b 1138e "
    "11390-113b5 113b7 113d1 113d3 11740-11746 11ab0-11abf 11bc0-11be0 11f02 11f04-11f10 11f12-11f33 "
    "12f90-12ff0 1342f 13441-13446 13460-143fa 16100-1611d 16a70-16abe 16d40-16d6c 18cff 1aff0-1aff3 "
    "1aff5-1affb 1affd-1affe 1b11f-1b122 1b132 1b155 1df00-1df1e 1df25-1df2a 1e030-1e06d 1e290-1e2ad "
    "1e4d0-1e4eb 1e5d0-1e5ed 1e5f0 1e7e0-1e7e6 1e7e8-1e7eb 1e7ed-1e7ee 1e7f0-1e7fe 2a6de-2a6df "
    "2b735-2b739 2ebf0-2ee5d 31350-323af"
)
"""Letters that came after Unicode 13, up to Unicode 16."""

_NEWER_NUMBERS = _ranges(
    "10d40-10d49 116d0-116e3 11bf0-11bf9 11f50-11f59 16130-16139 16ac0-16ac9 16d70-16d79 1ccf0-1ccf9 "
    "1d2c0-1d2d3 1e4f0-1e4f9 1e5f1-1e5fa"
)

_NEWER_MARKS = _ranges(
    "5c8-5c9 7fd 897-89f 8ca-8d3 9fe c3c d3b-d3c eba 1715 1abf-1af0 1df6-1dfa a82c 10d24-10d27 "
    "10d69-10d6d 10eab-10eac 10ecb-10ecf 10ef0-10efb 10efd-10eff 10f46-10f50 10f82-10f85 11070 1133b "
    "113ce-113d0 1145e 11839-1183a 11930 1193d-1193e 11943 119e0 11a34 11a47 11a99 11d42 11d44-11d45 "
    "11d97 11f41-11f42 1612f 16ff0-16ff1 1d127-1d128 1d250-1d252 1d25b-1d25c 1d25f 1d280-1d281 1e08f "
    "1e130-1e136 1e2ae 1e2ec-1e2ef 1e4ec-1e4ef 1e5ee-1e5ef 1e6e3 1e6e6 1e6ee-1e6ef 1e6f5"
)
"""Combining marks newer than Unicode 9. Composing must not reorder or join them, nor marks across them."""

_CAPITALS = {
    code: chr(code + distance)
    for codes, distance in (
        ([ord("Σ")], 0x20),
        ([0x1C89, 0xA7C0, 0xA7CC, *range(0xA7CE, 0xA7DC, 2)], 1),
        ([0x2C2F], 0x30),
        ([0xA7CB], 0x264 - 0xA7CB),
        ([0xA7DC], 0x19B - 0xA7DC),
        (
            [*range(0x10570, 0x1057B), *range(0x1057C, 0x1058B), *range(0x1058C, 0x10593), 0x10594, 0x10595],
            0x27,
        ),
        (range(0x10D50, 0x10D66), 0x20),
        (range(0x16EA0, 0x16EB9), 0x1B),
    )
    for code in codes
}
"""Capitals newer than Unicode 13; and sigma, which str.lower turns into another letter at a word's end."""

_BETWEEN_MARKS = re.compile(
    "([" + "".join(f"{chr(first)}-{chr(last)}" for first, last in _NEWER_MARKS) + "])"
)


def _within(ranges: list[tuple[int, int]], code: int) -> bool:
    place = bisect_right(ranges, (code, 0x10FFFF)) - 1
    return place >= 0 and code <= ranges[place][1]


class _Shapes(dict[int, str]):
    """Maps code points to the characters of `shape`, each worked out when it is first needed."""

    def __missing__(self, code: int) -> str:
        character = chr(code)
        if code < 128:
            return character
        category = unicodedata.category(character)
        if category[0] == "L" or (category == "Cn" and _within(_NEWER_LETTERS, code)):
            return "z"
        if category[0] == "N" or (category == "Cn" and _within(_NEWER_NUMBERS, code)):
            return "0"
        return " " if character.isspace() else "!"


_SHAPES = _Shapes()


def composed(text: str) -> str:
    """Return `text` in normalisation form C."""
    if text.isascii():
        return text
    return "".join(unicodedata.normalize("NFC", part) for part in _BETWEEN_MARKS.split(text))


def lowered(text: str) -> str:
    """Return `text` in lower case, each character by itself."""
    return (text if text.isascii() else text.translate(_CAPITALS)).lower()


def shape(text: str) -> str:
    """Replace each non-ASCII character by an ASCII one, so that `re`, which has no \\p{L}, can split it.

    "z" stands for a letter, "0" for a number, " " for a space, "!" for anything else.
    """
    return text if text.isascii() else text.translate(_SHAPES)
