"""Encodes texts as token ids by a bundle's tokenizer.json, which Hugging Face's `tokenizers` reads and runs.

That library runs whatever steps a file names: 1 kB can make it take all memory, which ends the process. So
only the steps of CLIP, SigLIP 2 and TIPSv2 are run, each of them once.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from anytraverse.errors import PerceiverError
from anytraverse.regular_file import read_regular
from anytraverse.release import to_install

MAX_FILE_BYTES = 32 << 20
"""A vocabulary of SigLIP 2's size takes 18 MB. A file of nothing but long tokens takes fifty times its size
of memory."""
LONGEST = 4096
"""The most tokens that a text may be cut to, or filled up to."""
_LONGEST_STATE = 4096
"""The most characters of JSON for what is put around a text's ids."""
_LONGEST_STEPS = 16384
"""The most characters of JSON for all but the vocabulary. The library compiles each pattern as it reads it,
and a character of a pattern may take a kilobyte of memory."""
_REMEDY = "Copy the bundle here again, or make it with `anytraverse export` of this version."

SPACE = "▁"
"""Stands for a space in the tokens of SentencePiece."""
CLIP_WORDS = r"'s|'t|'re|'ve|'m|'ll|'d|[\p{L}]+|[\p{N}]|[^\s\p{L}\p{N}]+"
_CLIP_SPECIAL = r"<\|startoftext\|>|<\|endoftext\|>"
LOWER = {"type": "Lowercase"}
_NORMALIZERS = (
    LOWER,
    {"type": "NFC"},
    {"type": "NFKC"},
    {"type": "Replace", "pattern": {"Regex": r"\s+"}, "content": " "},
    {"type": "Replace", "pattern": {"String": " "}, "content": SPACE},
    {"type": "Replace", "pattern": {"Regex": " {2,}"}, "content": " "},
    {"type": "Replace", "pattern": {"Regex": " {2,}"}, "content": SPACE},
    {"type": "Strip", "strip_left": False, "strip_right": True},
)
_SPLITS = (
    *(
        {"type": "Split", "pattern": {"Regex": pattern}, "behavior": "Removed", "invert": True}
        for pattern in (CLIP_WORDS, f"{_CLIP_SPECIAL}|{CLIP_WORDS}")  # older transformers, newer ones
    ),
    {"type": "Split", "pattern": {"String": " "}, "behavior": "MergedWithPrevious", "invert": False},
    {"type": "ByteLevel", "add_prefix_space": False, "trim_offsets": True, "use_regex": True},
    {"type": "WhitespaceSplit"},
    {"type": "Metaspace", "replacement": SPACE, "prepend_scheme": "always", "split": True},
)


class Tokenizer:
    """Encodes text as token ids."""

    def __init__(self, content: bytes) -> None:
        """content: a tokenizer.json. Raises ValueError with the reason for one that cannot be used."""
        if content.startswith(b'{"format"'):
            raise ValueError("an earlier version wrote it")
        library = load_tokenizers()
        _check_length(content)
        with _panics_caught():
            self._tokenizer = library.Tokenizer.from_buffer(content)
            _check(self._tokenizer)
            if max(self._tokenizer.encode("a").ids, default=0) >= self.size():
                raise ValueError("it puts tokens around a text that it does not have")

    @classmethod
    def load(cls, path: Path) -> Tokenizer:
        """Read a bundle's file. Raises PerceiverError with the reason and a remedy."""
        try:
            content = read_regular(path, MAX_FILE_BYTES + 1)
            if len(content) > MAX_FILE_BYTES:
                raise ValueError(f"it has more than {MAX_FILE_BYTES} bytes")
            return cls(content)
        except (OSError, ValueError) as error:
            raise PerceiverError(f"{path} is not a tokenizer that can be used: {error}. {_REMEDY}") from error

    def encode(self, text: str) -> list[int]:
        """Return the ids of a text, cut to the length that the file states, and filled up if it says so.

        Raises PerceiverError, also for half a surrogate pair, which is not a character.
        """
        try:
            with _panics_caught():
                ids: list[int] = self._tokenizer.encode(text).ids
        except ValueError as error:
            raise PerceiverError(f"{text[:60]!r} cannot be encoded: {error}") from error
        return ids

    def size(self) -> int:
        """Return the highest id of a token, and 1."""
        return 1 + max(self._tokenizer.get_vocab(with_added_tokens=True).values(), default=-1)


def load_tokenizers() -> Any:
    """Import `tokenizers`, without threads of its own. Raises PerceiverError when it is not installed."""
    os.environ.setdefault("TOKENIZERS_PARALLELISM", "false")
    try:
        import tokenizers
    except ImportError:
        raise PerceiverError(f"words of any kind need tokenizers: {to_install('words')}") from None
    return tokenizers


def _check_length(content: bytes) -> None:
    """Raise ValueError for what is no JSON object, or has more than a vocabulary and some short steps."""
    try:
        told = json.loads(content)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    if not isinstance(told, dict):
        raise ValueError("it is no JSON object")
    steps = {name: value for name, value in told.items() if name not in ("model", "added_tokens")}
    if len(json.dumps(steps)) > _LONGEST_STEPS:
        raise ValueError(f"its steps have more than {_LONGEST_STEPS} characters")


def _check(made: Any) -> None:
    """Raise ValueError for what could make of a short text anything but a few thousand ids at once."""
    kind = type(made.model).__name__
    if kind != "BPE" or made.model.dropout:
        raise ValueError(f"its model is {kind}, and only BPE without dropout can be used")
    for part, inner, known in (
        (made.normalizer, "normalizers", _NORMALIZERS),
        (made.pre_tokenizer, "pretokenizers", _SPLITS),
    ):
        state = {} if part is None else json.loads(part.__getstate__())
        steps = state[inner] if state.get("type") == "Sequence" else [state]
        for step in steps:
            if step not in known or len(steps) > len(known) or steps.count(step) > 1:
                named = json.dumps(step, ensure_ascii=False)[:80]
                raise ValueError(f"{named} is not among the {inner} that can be used, each of them once")
    around = "{}" if made.post_processor is None else made.post_processor.__getstate__()
    last = json.loads(around).get("type")
    if last not in ("RobertaProcessing", "TemplateProcessing") or len(around) > _LONGEST_STATE:
        raise ValueError(f"its post_processor is {last}, or too long")
    cut, fill = made.truncation or {}, made.padding
    context = cut.get("max_length", 0)
    whole = {"max_length": context, "stride": 0, "strategy": "longest_first", "direction": "right"}
    if cut != whole or not 2 <= context <= LONGEST:
        raise ValueError(f"it does not cut texts at their end, to 2 to {LONGEST} tokens")
    if fill is not None and (fill["length"] != context or fill["pad_to_multiple_of"] is not None):
        raise ValueError("it fills texts up to another length than it cuts them to")


@contextmanager
def _panics_caught() -> Iterator[None]:
    """Turn whatever the library raises into ValueError. Its panics are no Exception."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:
        raise ValueError(" ".join(str(error).split())[:200]) from error
