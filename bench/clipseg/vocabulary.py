"""Makes a tokenizer of CLIP's kind and size, since CLIP's own vocabulary is not ours to ship."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from string import ascii_lowercase

START, END = "<|startoftext|>", "<|endoftext|>"
END_OF_WORD = "</w>"
FULL_SIZE = 49408
CONTEXT = 77


def byte_symbols() -> list[str]:
    """Returns the printable characters for the 256 bytes of a byte-level vocabulary, ordered by id.

    Bytes that print stand for themselves; the others become the characters from U+0100 on.
    """
    own = [*range(0x21, 0x7F), *range(0xA1, 0xAD), *range(0xAE, 0x100)]
    others = [byte for byte in range(256) if byte not in own]
    return [chr(byte) for byte in own] + [chr(0x100 + index) for index in range(len(others))]


def make_merges(count: int) -> list[tuple[str, str]]:
    """Makes `count` merges of letters: pairs, triples and fours, each inside and at the end of a word."""
    merges: list[tuple[str, str]] = []
    stems = list(ascii_lowercase)
    while len(merges) < count:
        pairs = list(product(stems, ascii_lowercase))
        merges += [(stem, letter + END_OF_WORD) for stem, letter in pairs]
        merges += pairs
        stems = [stem + letter for stem, letter in pairs]
    return merges[:count]


def write_tokenizer(folder: Path, size: int = FULL_SIZE) -> None:
    """Writes a CLIP tokenizer of `size` tokens, the last two start and end, in the four files of the hub."""
    symbols = byte_symbols()
    alphabet = symbols + [symbol + END_OF_WORD for symbol in symbols]
    if size < len(alphabet) + 2:
        raise ValueError(
            f"a vocabulary of {size} tokens does not hold the bytes: give {len(alphabet) + 2} at least"
        )
    merges = make_merges(size - len(alphabet) - 2)
    tokens = [*alphabet, *("".join(merge) for merge in merges), START, END]
    vocabulary = {token: index for index, token in enumerate(tokens)}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.json").write_text(json.dumps(vocabulary, ensure_ascii=False), encoding="utf-8")
    lines = ["#version: 0.2", *(" ".join(merge) for merge in merges)]
    (folder / "merges.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    names = {"bos_token": START, "eos_token": END, "unk_token": END, "pad_token": END}
    (folder / "special_tokens_map.json").write_text(json.dumps(names, indent=2))
    settings = {
        **names,
        "add_prefix_space": False,
        "do_lower_case": True,
        "errors": "replace",
        "model_max_length": CONTEXT,
        "tokenizer_class": "CLIPTokenizer",
    }
    (folder / "tokenizer_config.json").write_text(json.dumps(settings, indent=2))
