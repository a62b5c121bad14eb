"""Splits a text into the words that CLIP's byte-pair encoding works on.

The steps and the pattern are CLIP's (openai/CLIP, simple_tokenizer.py) as transformers' CLIPTokenizer runs
them: compose (NFC), lower the case, split.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from anytraverse.perception.clipseg.unicode_tables import composed, lowered, shape

_WORD = re.compile(
    r"(<\|)(startoftext|endoftext)(\|>)|'s|'t|'re|'ve|'m|'ll|'d|[a-z]+|[0-9]|[^\sa-z0-9]+",
    re.ASCII,
)
"""Matches the `shape` of a text. There "z" stands for all other letters; no fixed word here contains a z."""


def words(text: str) -> Iterator[str]:
    """Yield contractions, runs of letters, single digits, and runs of anything else but spaces.

    "<|endoftext|>" becomes three words: transformers splits the matches of CLIP's pattern once more by
    GPT-2's. It comes here only when typed in capitals; otherwise it is a special token.
    """
    cleaned = lowered(composed(text))
    for match in _WORD.finditer(shape(cleaned)):
        for first, last in match.regs[1:] if match[1] else match.regs[:1]:
            yield cleaned[first:last]
