"""CLIP's way from a text to the words that byte-pair encoding works on.

The steps and the pattern are CLIP's (openai/CLIP, simple_tokenizer.py) as transformers' CLIPTokenizer runs
them: composed (NFC), in lower case, split.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from anytraverse.perception.clipseg.unicode_tables import composed, lowered, shape

_WORD = re.compile(
    r"(<\|)(startoftext|endoftext)(\|>)|'s|'t|'re|'ve|'m|'ll|'d|[a-z]+|[0-9]|[^\sa-z0-9]+",
    re.ASCII,
)
"""For the shape of a text: "z", which stands for the other letters, is in none of its fixed words."""


def words(text: str) -> Iterator[str]:
    """The words of `text`: contractions, runs of letters, single digits, runs of anything else but spaces.

    "<|endoftext|>" is three words here (it comes here typed in capitals; otherwise it is a special token):
    transformers splits the pieces of CLIP's pattern once more, by GPT-2's.
    """
    cleaned = lowered(composed(text))
    for match in _WORD.finditer(shape(cleaned)):
        for first, last in match.regs[1:] if match[1] else match.regs[:1]:
            yield cleaned[first:last]
