"""The tokenizer: merges worked by hand, where a text is cut, and what a file must hold."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import PerceiverError
from anytraverse.perception.clipseg import tokenizer as tokenizer_module
from anytraverse.perception.clipseg.tokenizer import Tokenizer, save_tokenizer

CONTEXT = 77
START, END = "<|startoftext|>", "<|endoftext|>"
MERGES = [
    ("a", "s"),
    ("s", "s</w>"),
    ("as", "s</w>"),
    ("r", "as"),
    ("g", "r"),
    ("gr", "ass</w>"),
    ("a", "ss</w>"),
]


def vocabulary_of(merges: list[tuple[str, str]]) -> dict[str, int]:
    """Ids as CLIP numbers them: 256 bytes, 256 bytes that end a word, the products of merges, start, end."""
    symbols = tokenizer_module.byte_alphabet()
    products = [left + right for left, right in merges]
    tokens = [*symbols, *(f"{symbol}</w>" for symbol in symbols), *products, START, END]
    return {token: token_id for token_id, token in enumerate(dict.fromkeys(tokens))}


def tokenizer_of(
    vocabulary: dict[str, int], merges: list[tuple[str, str]], context: int = CONTEXT
) -> Tokenizer:
    return Tokenizer(vocabulary, merges, context, vocabulary[START], vocabulary[END])


@pytest.fixture
def by_hand() -> Tokenizer:
    return tokenizer_of(vocabulary_of(MERGES), MERGES)


def tokens_of(tokenizer: Tokenizer, text: str) -> list[str]:
    names = {token_id: token for token, token_id in vocabulary_of(MERGES).items()}
    ids = tokenizer.encode(text)
    assert (names[ids[0]], names[ids[-1]]) == (START, END)
    return [names[token_id] for token_id in ids[1:-1]]


def test_the_merge_of_lowest_rank_comes_first_and_may_take_the_letters_of_a_later_one(
    by_hand: Tokenizer,
) -> None:
    # g r a s s</w>: (a, s) of rank 0 leaves (s, s</w>) of rank 1 no first s; then come ranks 2, 4 and 5.
    assert tokens_of(by_hand, "grass") == ["grass</w>"]
    assert tokens_of(by_hand, "ss") == ["ss</w>"]
    # (as, s</w>) of rank 2 comes before (r, as) of rank 3, which comes before (g, r) when no s is last.
    assert tokens_of(by_hand, "rass") == ["r", "ass</w>"]
    assert tokens_of(by_hand, "grasp") == ["g", "ras", "p</w>"]


def test_of_equal_pairs_the_leftmost_is_merged_first() -> None:
    merges = [("a", "a")]
    vocabulary = vocabulary_of(merges)
    ids = tokenizer_of(vocabulary, merges).encode("aaaa")
    assert ids[1:-1] == [vocabulary["aa"], vocabulary["a"], vocabulary["a</w>"]]


def test_words_end_where_a_space_or_another_kind_of_character_begins(by_hand: Tokenizer) -> None:
    assert tokens_of(by_hand, " Grass,GRASS\t12 ") == ["grass</w>", ",</w>", "grass</w>", "1</w>", "2</w>"]
    assert tokens_of(by_hand, "ass's") == ["ass</w>", "'", "s</w>"]


def test_a_letter_beyond_ascii_is_spelled_in_the_symbols_of_its_bytes(by_hand: Tokenizer) -> None:
    assert tokens_of(by_hand, "é") == ["Ã", "©</w>"]
    assert tokens_of(by_hand, "e\u0301") == ["Ã", "©</w>"]


def test_special_tokens_typed_in_a_text_are_themselves(by_hand: Tokenizer) -> None:
    assert tokens_of(by_hand, f"grass{END}ss{START}") == ["grass</w>", END, "ss</w>", START]


def test_an_empty_text_is_start_and_end(by_hand: Tokenizer) -> None:
    assert tokens_of(by_hand, "") == tokens_of(by_hand, " \n") == []


def test_a_byte_without_a_token_becomes_the_end_token() -> None:
    vocabulary = {"a": 0, "a</w>": 1, START: 2, END: 3}
    assert tokenizer_of(vocabulary, []).encode("ab a") == [2, 0, 3, 1, 3]


def test_a_long_text_is_cut_and_still_ends_with_the_end_id(by_hand: Tokenizer) -> None:
    vocabulary = vocabulary_of(MERGES)
    assert by_hand.encode("grass " * 1000) == [
        vocabulary[START],
        *[vocabulary["grass</w>"]] * 75,
        vocabulary[END],
    ]
    assert len(tokenizer_of(vocabulary, MERGES, context=3).encode("grass grass")) == 3


def test_half_a_surrogate_pair_is_refused(by_hand: Tokenizer) -> None:
    with pytest.raises(UnicodeEncodeError):
        by_hand.encode("grass \ud800")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"context": 2}, "context is 2"),
        ({"context": 10**9}, "context is 1000000000"),
        ({"start": 10**6}, "start 1000000"),
        ({"end": 0, "start": 0}, "start 0 and end 0"),
        ({"vocabulary": {START: 0, END: 0}}, "share an id"),
        ({"vocabulary": {START: 0, END: 1}, "start": 0, "end": 1}, "merge 0 needs 'a'"),
        ({"vocabulary": {}}, "not two tokens"),
    ],
)
def test_parts_that_do_not_fit_together_are_refused(change: dict[str, Any], said: str) -> None:
    vocabulary = vocabulary_of(MERGES)
    parts = {"context": CONTEXT, "start": vocabulary[START], "end": vocabulary[END]}
    with pytest.raises(ValueError, match=said):
        Tokenizer(**{"vocabulary": vocabulary, "merges": MERGES, **parts, **change})


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    vocabulary = vocabulary_of(MERGES)
    path = tmp_path / "tokenizer.json"
    save_tokenizer(path, vocabulary, MERGES, CONTEXT, vocabulary[START], vocabulary[END])
    return path


def test_what_was_saved_is_loaded(saved: Path, by_hand: Tokenizer) -> None:
    loaded = Tokenizer.load(saved)
    assert (loaded.context, loaded.start, loaded.end) == (by_hand.context, by_hand.start, by_hand.end)
    for text in ("", "grass", "dry grass!", "草地", END):
        assert loaded.encode(text) == by_hand.encode(text)


def test_ids_with_gaps_are_not_saved(tmp_path: Path) -> None:
    path = tmp_path / "tokenizer.json"
    with pytest.raises(ValueError, match="gaps"):
        save_tokenizer(path, {START: 0, END: 2}, [], CONTEXT, 0, 2)
    assert not path.exists()


def assert_refused(path: Path, said: str = "can be used") -> None:
    with pytest.raises(PerceiverError, match=said) as refusal:
        Tokenizer.load(path)
    assert str(path) in str(refusal.value)
    assert "anytraverse export" in str(refusal.value)


@settings(max_examples=30)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_torn_file_is_refused_with_a_remedy(tmp_path_factory: pytest.TempPathFactory, share: float) -> None:
    vocabulary = vocabulary_of(MERGES)
    path = tmp_path_factory.getbasetemp() / "torn.json"
    save_tokenizer(path, vocabulary, MERGES, CONTEXT, vocabulary[START], vocabulary[END])
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    assert_refused(path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\xff\xfe\x00", "can be used"),
        (b"[" * 100_000, "can be used"),
        (b"[]", "another program's"),
        (b'{"version":"1.0","added_tokens":[],"model":{}}', "another program's"),
        (b'{"format":true}', "another program's"),
        (b'{"format":2}', "format 2, this version of anytraverse reads 1"),
        (b'{"format":1}', "its fields are format, expected context"),
    ],
)
def test_a_foreign_file_is_refused_with_a_remedy(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "tokenizer.json"
    path.write_bytes(content)
    assert_refused(path, said)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("context", "77", "context is '77', expected a whole number"),
        ("context", True, "context is 'True'"),
        ("context", -1, "context is -1"),
        ("start", None, "start is 'None'"),
        ("end", 1.5, "end is '1.5'"),
        ("end", 10**9, "not two tokens"),
        ("vocabulary", {"a": 0}, "not a list of texts"),
        ("vocabulary", ["a", 1], "not a list of texts"),
        ("vocabulary", ["a", "a"], "twice"),
        ("merges", "a s", "not a list of ids"),
        ("merges", [0, 1, 2], "two for each merge"),
        ("merges", [0, 10**6], "no id of the"),
        ("merges", [0, -1], "no id of the"),
        ("merges", [0, 1.0], "no id of the"),
        ("merges", [0, False], "no id of the"),
        ("merges", [0, 0], "merge 0 needs 'ĀĀ'"),
        ("comment", "", "its fields are comment"),
    ],
)
def test_a_field_that_is_wrong_is_named(saved: Path, field: str, value: object, said: str) -> None:
    content = json.loads(saved.read_bytes())
    saved.write_text(json.dumps({**content, field: value}))
    assert_refused(saved, said)


def test_a_file_that_is_missing_or_too_big_is_refused(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_refused(saved.with_name("other.json"), "No such file")
    monkeypatch.setattr(tokenizer_module, "MAX_FILE_BYTES", 100)
    assert_refused(saved, "100 at most")
