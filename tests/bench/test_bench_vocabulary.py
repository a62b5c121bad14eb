"""The made tokenizer."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bench.clipseg.vocabulary import END, FULL_SIZE, START, byte_symbols, make_merges, write_tokenizer


def test_every_byte_has_a_symbol_of_its_own_that_prints() -> None:
    symbols = byte_symbols()
    assert len(set(symbols)) == 256
    assert all(symbol.isprintable() and not symbol.isspace() for symbol in symbols)


def test_start_and_end_have_clips_own_ids(tmp_path: Path) -> None:
    write_tokenizer(tmp_path)
    vocabulary = json.loads((tmp_path / "vocab.json").read_text(encoding="utf-8"))
    assert sorted(vocabulary.values()) == list(range(FULL_SIZE))
    assert (vocabulary[START], vocabulary[END]) == (49406, 49407)


def test_every_merge_joins_what_is_there_before_it() -> None:
    known = {*"abcdefghijklmnopqrstuvwxyz"} | {letter + "</w>" for letter in "abcdefghijklmnopqrstuvwxyz"}
    for left, right in make_merges(48894):
        assert left in known
        assert right in known
        assert left + right not in known
        known.add(left + right)


def test_a_size_that_does_not_hold_the_bytes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="give 514 at least"):
        write_tokenizer(tmp_path, 500)


def test_transformers_reads_it_and_splits_words_into_its_pieces(tmp_path: Path) -> None:
    transformers = pytest.importorskip("transformers", reason="the extra `export` is not installed")
    write_tokenizer(tmp_path, 2048)
    tokenizer = transformers.AutoTokenizer.from_pretrained(tmp_path)
    tokens = tokenizer.convert_ids_to_tokens(tokenizer("Dirt é")["input_ids"])
    assert tokens == [START, "di", "rt</w>", "Ã", "©</w>", END]
