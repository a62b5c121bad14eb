"""Encodes text as CLIP's tokenizer does: byte-level byte-pair encoding with an end-of-word mark.

Needs only the standard library. Gives the same ids as transformers' CLIPTokenizer (the fast one) made from
the same vocabulary and merges. One thing depends on a checkpoint's configuration: with some, the start token
typed in capitals is still the start token; here it is plain text, which is CLIPTokenizer's default.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import count, islice
from pathlib import Path
from typing import Any

from anytraverse.errors import PerceiverError
from anytraverse.perception.clipseg.pretokenizer import words
from anytraverse.perception.merges import Merges

FORMAT = 1
MAX_FILE_BYTES = 32 << 20
_FIELDS = {"format", "context", "start", "end", "vocabulary", "merges"}
_END_OF_WORD = "</w>"
_REMEDY = "Copy the bundle here again, or make it with `anytraverse export` of this version."


class Tokenizer:
    """Encodes text as token ids.

    vocabulary: token -> id >= 0, each id once. merges: pairs of tokens in order of rank; a merged pair is a
    token too. context: the most ids of a text, 3 to 65536. start, end: the ids before and after a text; their
    tokens typed in a text become these ids, and a byte without a token becomes `end`.
    Raises ValueError with the reason when these do not fit together.
    """

    def __init__(
        self,
        vocabulary: Mapping[str, int],
        merges: Iterable[tuple[str, str]],
        context: int,
        start: int,
        end: int,
    ) -> None:
        names = {token_id: token for token, token_id in vocabulary.items()}
        if len(names) != len(vocabulary) or min(names, default=0) < 0:
            raise ValueError("two tokens share an id, or an id is negative")
        if not 3 <= context <= 65536:
            raise ValueError(f"context is {context}, expected 3 (start, one token, end) to 65536")
        if start == end or not names.get(start) or not names.get(end):
            raise ValueError(f"start {start} and end {end} are not two tokens of the vocabulary")
        self.context, self.start, self.end = context, start, end
        self._literals = re.compile(f"({re.escape(names[start])}|{re.escape(names[end])})")
        self._literal_ids = {names[start]: start, names[end]: end}
        alphabet = byte_alphabet()
        self._inner = [vocabulary.get(symbol, end) for symbol in alphabet]
        self._last = [vocabulary.get(symbol + _END_OF_WORD, end) for symbol in alphabet]
        self._merges = Merges(vocabulary, merges)

    @classmethod
    def load(cls, path: Path) -> Tokenizer:
        """Read what `save_tokenizer` wrote to `path`. Raises PerceiverError with the reason and a remedy."""
        try:
            return cls(**_read(path))
        except (OSError, ValueError, RecursionError) as error:
            raise PerceiverError(f"{path} is not a tokenizer that can be used: {error}. {_REMEDY}") from error

    def encode(self, text: str) -> list[int]:
        """Return the start id, the ids of `text` and the end id: `context` ids at most, the rest is cut off.

        Raises UnicodeEncodeError for half a surrogate pair, which is not a character.
        """
        return [self.start, *islice(self._tokens(text), self.context - 2), self.end]

    def _tokens(self, text: str) -> Iterator[int]:
        for part in self._literals.split(text):
            if part in self._literal_ids:
                yield self._literal_ids[part]
                continue
            for word in words(part):
                octets = word.encode()
                yield from self._merges.apply(
                    [*(self._inner[octet] for octet in octets[:-1]), self._last[octets[-1]]]
                )


def save_tokenizer(
    path: Path,
    vocabulary: Mapping[str, int],
    merges: Sequence[tuple[str, str]],
    context: int,
    start: int,
    end: int,
) -> None:
    """Write a tokenizer as one compact JSON object.

    Its fields are format, context, start, end, vocabulary (tokens by id) and merges (a flat list of pairs of
    ids). Raises ValueError when the parts make no tokenizer or the ids are not 0 to n - 1, and OSError.
    """
    Tokenizer(vocabulary, merges, context, start, end)
    tokens = sorted(vocabulary, key=vocabulary.__getitem__)
    if vocabulary[tokens[-1]] != len(tokens) - 1:
        raise ValueError(
            f"{len(tokens)} tokens have ids up to {vocabulary[tokens[-1]]}: leave no gaps between ids"
        )
    content = {
        "format": FORMAT,
        "context": context,
        "start": start,
        "end": end,
        "vocabulary": tokens,
        "merges": [vocabulary[token] for pair in merges for token in pair],
    }
    path.write_text(json.dumps(content, ensure_ascii=False, separators=(",", ":")), encoding="utf-8")


def _read(path: Path) -> dict[str, Any]:
    """Read the arguments of Tokenizer from a file. Raises OSError or ValueError."""
    if (size := path.stat().st_size) > MAX_FILE_BYTES:
        raise ValueError(f"it has {size} bytes, {MAX_FILE_BYTES} at most")
    content = json.loads(path.read_bytes())
    if not isinstance(content, dict) or type(content.get("format")) is not int:
        raise ValueError("it has no format number, so it is another program's file")
    if content["format"] != FORMAT:
        raise ValueError(f"it has format {content['format']}, this version of anytraverse reads {FORMAT}")
    if content.keys() != _FIELDS:
        raise ValueError(
            f"its fields are {', '.join(sorted(content))}, expected {', '.join(sorted(_FIELDS))}"
        )
    numbers = {name: content[name] for name in ("context", "start", "end")}
    for name, number in numbers.items():
        if type(number) is not int:
            raise ValueError(f"{name} is {str(number)[:40]!r}, expected a whole number")
    tokens, ids = content["vocabulary"], content["merges"]
    if not isinstance(tokens, list) or not all(isinstance(token, str) for token in tokens):
        raise ValueError("vocabulary is not a list of texts")
    vocabulary = {token: token_id for token_id, token in enumerate(tokens)}
    if len(vocabulary) != len(tokens):
        raise ValueError("a token stands twice in vocabulary")
    if not isinstance(ids, list) or len(ids) % 2:
        raise ValueError("merges is not a list of ids, two for each merge")
    if not all(type(token_id) is int and 0 <= token_id < len(tokens) for token_id in ids):
        raise ValueError(f"merges holds something that is no id of the {len(tokens)} tokens")
    merges = ((tokens[left], tokens[right]) for left, right in zip(ids[::2], ids[1::2], strict=True))
    return {"vocabulary": vocabulary, "merges": merges, **numbers}


def byte_alphabet() -> list[str]:
    """Return the character that stands for each byte in tokens, as GPT-2 chose them.

    It is the byte's Latin-1 character where that is visible, else the next one from U+0100 on.
    """
    visible = {*range(0x21, 0x7F), *range(0xA1, 0xAD), *range(0xAE, 0x100)}
    substitutes = count(0x100)
    return [chr(octet if octet in visible else next(substitutes)) for octet in range(256)]
