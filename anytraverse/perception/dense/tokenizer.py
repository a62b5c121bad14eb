"""Encodes text as SentencePiece's byte-pair encoding does, as SigLIP 2 (Gemma's tokens) and TIPSv2 use it.

Needs only the standard library. Gives the same ids as the tokenizers of transformers for ASCII texts; other
texts are composed by Python's NFKC where the model's own table would do it (`Rules.compose`).
"""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from anytraverse.errors import PerceiverError
from anytraverse.perception.merges import Merges

FORMAT = 1
MAX_FILE_BYTES = 64 << 20
SPACE = "▁"
"""Stands for a space in tokens."""
_REMEDY = "Copy the bundle here again, or make it with `anytraverse export` of this version."


@dataclass(frozen=True, kw_only=True)
class Rules:
    """Describes how a text becomes ids.

    context: the most ids of a text, 2 to 4096. lower: letters are lowered first. compose: NFKC comes first.
    split: every word is encoded by itself, with a space before it; False: the whole text, no space added.
    before, after: ids around a text. pad: the id that fills it up to `context`, -1: it is not filled.
    pad_left: whether that comes before the text. Raises ValueError for numbers out of range.
    """

    context: int
    lower: bool
    compose: bool
    split: bool
    before: tuple[int, ...]
    after: tuple[int, ...]
    pad: int
    pad_left: bool

    def __post_init__(self) -> None:
        if not 2 <= self.context <= 4096:
            raise ValueError(f"context is {self.context}, expected 2 to 4096")
        if len(self.before) + len(self.after) >= self.context:
            raise ValueError("the ids around a text leave no room for it")
        if min((*self.before, *self.after), default=0) < 0 or self.pad < -1:
            raise ValueError("an id is negative")


class Tokenizer:
    """Encodes text as token ids by `rules`.

    vocabulary: token -> id >= 0; a character without a token becomes the tokens of its bytes, "<0x00>" to
    "<0xFF>". merges: pairs of tokens in order of rank. Raises ValueError when these do not fit together.
    """

    def __init__(
        self, vocabulary: Mapping[str, int], merges: Sequence[tuple[str, str]], rules: Rules
    ) -> None:
        if len(set(vocabulary.values())) != len(vocabulary) or min(vocabulary.values(), default=0) < 0:
            raise ValueError("two tokens share an id, or an id is negative")
        missing = [name for name in map(_byte_token, range(256)) if name not in vocabulary]
        if missing:
            raise ValueError(f"it has no token for the byte {missing[0]}")
        self.rules = rules
        self._ids = dict(vocabulary)
        self._merges = Merges(vocabulary, merges)

    @classmethod
    def load(cls, path: Path) -> Tokenizer:
        """Read what `save_tokenizer` wrote to `path`. Raises PerceiverError with the reason and a remedy."""
        try:
            return _read(path)
        except (OSError, ValueError, RecursionError) as error:
            raise PerceiverError(f"{path} is not a tokenizer that can be used: {error}. {_REMEDY}") from error

    def encode(self, text: str) -> list[int]:
        """Return the ids of a text, at most `rules.context`; what does not fit is cut off at its end.

        Raises UnicodeEncodeError for half a surrogate pair, which is not a character.
        """
        rules = self.rules
        if rules.compose:
            text = unicodedata.normalize("NFKC", text)
        if rules.lower:
            text = text.lower()
        pieces = [SPACE + word for word in text.split()] if rules.split else [text.replace(" ", SPACE)]
        ids = [token for piece in pieces for token in self._merges.apply(self._symbols(piece))]
        room = rules.context - len(rules.before) - len(rules.after)
        whole = [*rules.before, *ids[:room], *rules.after]
        filling = [rules.pad] * (rules.context - len(whole)) if rules.pad >= 0 else []
        return [*filling, *whole] if rules.pad_left else [*whole, *filling]

    def _symbols(self, piece: str) -> list[int]:
        found: list[int] = []
        for character in piece:
            token = self._ids.get(character)
            if token is not None:
                found.append(token)
            else:
                found += [self._ids[_byte_token(octet)] for octet in character.encode()]
        return found


def save_tokenizer(
    path: Path, vocabulary: Mapping[str, int], merges: Sequence[tuple[str, str]], rules: Rules
) -> None:
    """Write a tokenizer as one compact JSON object: format, rules, vocabulary (tokens by id) and merges.

    Raises ValueError when the parts make no tokenizer, and OSError.
    """
    Tokenizer(vocabulary, merges, rules)
    tokens: list[str | None] = [None] * (max(vocabulary.values()) + 1)
    for token, token_id in vocabulary.items():
        tokens[token_id] = token
    content = {
        "format": FORMAT,
        "rules": asdict(rules),
        "vocabulary": tokens,
        "merges": [vocabulary[token] for pair in merges for token in pair],
    }
    path.write_text(json.dumps(content, ensure_ascii=False, separators=(",", ":")), encoding="utf-8")


def _read(path: Path) -> Tokenizer:
    """Read a tokenizer's file. Raises OSError or ValueError."""
    if (size := path.stat().st_size) > MAX_FILE_BYTES:
        raise ValueError(f"it has {size} bytes, {MAX_FILE_BYTES} at most")
    content = json.loads(path.read_bytes())
    if not isinstance(content, dict) or content.keys() != {"format", "rules", "vocabulary", "merges"}:
        raise ValueError("its fields are not format, rules, vocabulary and merges")
    if content["format"] != FORMAT:
        raise ValueError(f"it has format {content['format']!r}, this version of anytraverse reads {FORMAT}")
    tokens, ids = content["vocabulary"], content["merges"]
    if not isinstance(tokens, list) or not all(token is None or isinstance(token, str) for token in tokens):
        raise ValueError("vocabulary is not a list of texts")
    vocabulary = {token: token_id for token_id, token in enumerate(tokens) if token is not None}
    if not vocabulary or len(vocabulary) != len(tokens) - tokens.count(None):
        raise ValueError("vocabulary is empty, or a token stands twice in it")
    if not isinstance(ids, list) or len(ids) % 2:
        raise ValueError("merges is not a list of ids, two for each merge")
    if not all(type(one) is int and 0 <= one < len(tokens) and tokens[one] is not None for one in ids):
        raise ValueError(f"merges holds something that is no id of the {len(tokens)} tokens")
    merges = [(tokens[left], tokens[right]) for left, right in zip(ids[::2], ids[1::2], strict=True)]
    rules = _rules(content["rules"])
    if max((*rules.before, *rules.after, rules.pad)) >= len(tokens):
        raise ValueError("an id around a text is not in the vocabulary")
    return Tokenizer(vocabulary, merges, rules)


def _rules(values: Any) -> Rules:
    kinds = {field.name: field.type for field in fields(Rules)}
    if not isinstance(values, dict) or values.keys() != kinds.keys():
        raise ValueError(f"rules are not {', '.join(kinds)}")
    for name, kind in kinds.items():
        value = values[name]
        if kind in ("int", "bool") and type(value).__name__ != kind:
            raise ValueError(f"{name} is {str(value)[:40]!r}, expected {kind}")
        if kind not in ("int", "bool") and not (
            isinstance(value, list) and all(type(one) is int for one in value)
        ):
            raise ValueError(f"{name} is {str(value)[:40]!r}, expected a list of ids")
    given: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in values.items()
    }
    return Rules(**given)


def _byte_token(octet: int) -> str:
    return f"<0x{octet:02X}>"
