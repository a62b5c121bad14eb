"""The same ids as transformers' CLIPTokenizer, with a vocabulary made here."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.perception.clipseg.tokenizer import Tokenizer, byte_alphabet, save_tokenizer

pytestmark = pytest.mark.needs_export

CONTEXT = 77
START, END = "<|startoftext|>", "<|endoftext|>"
ORDINARY = [
    *("grass", "dry", "bush", "tree", "gravel", "dirt", "path", "mud", "water", "rock", "puddle"),
    *("a", "photo", "of", "the", "muddy,", "don't", "it's", "Trail", "ROAD"),
]
ODD = [
    *(
        "straße",
        "ΟΔΟΣ",
        "σκόνη",
        "дорога",
        "草地",
        "道路",
        "طريق",
        "가",
        "각",
        "İstanbul",
        "ſ",
        "\u212a",
        "ﬁ",
    ),
    *(
        "e\u0301",
        "a\u0327\u0301",
        "\u0301\u0327",
        "\u0338",
        ">\u0338",
        "q\u0897\u0327",
        "\U00011935\U00011930",
    ),
    *(
        "👍🏽",
        "👨\u200d👩\u200d👧",
        "🏜\ufe0f",
        "\u200b",
        "\u200d",
        "\ufeff",
        "\u2028",
        "\x85",
        "\xa0",
        "\u3000",
    ),
    *("\t", "\n", "\r\n", "  ", "\x00", "\x1c", "\x1f", "\x7f", "\U00010d50", "\U00031350"),
    *("1234", "½", "²", "٣", "१", "Ⅷ", "'s", "'S", "'ll", "'LL", "we've", "''", "'"),
    *("!", "...", "?!", "-", "_", "a-b", "<|", "|>", "</w>", "<|stbrtoftext|>", "<|stàrtoftext|>"),
    *(START, END, START.upper(), END.upper(), f"!{END}!", f"{END.upper()}!!"),
]

Encode = Callable[[str], list[int]]
Vocabulary = tuple[dict[str, int], list[tuple[str, str]]]


def vocabulary_of(merges: list[tuple[str, str]]) -> dict[str, int]:
    """Ids as CLIP numbers them: 256 bytes, 256 bytes that end a word, the products of merges, start, end."""
    symbols = byte_alphabet()
    products = [left + right for left, right in merges]
    tokens = [*symbols, *(f"{symbol}</w>" for symbol in symbols), *products, START, END]
    return {token: token_id for token_id, token in enumerate(dict.fromkeys(tokens))}


@cache
def trained(count: int = 600) -> Vocabulary:
    """Byte-pair encoding trained on made words of many scripts: always the most frequent pair."""
    rng = random.Random(7)
    symbols = byte_alphabet()
    made = ["".join(rng.choices("aeiourstlndgm", k=rng.randint(2, 9))) for _ in range(250)]
    dense = ["".join(rng.choices("abcde", k=40)) for _ in range(60)]
    weighted = Counter(rng.choices([*made, *dense, *ORDINARY, *ODD], k=3000))
    corpus = []
    for word, weight in weighted.items():
        octets = [symbols[octet] for octet in word.lower().encode()]
        corpus.append(([*octets[:-1], f"{octets[-1]}</w>"], weight))
    merges: list[tuple[str, str]] = []
    while len(merges) < count:
        pairs: Counter[tuple[str, str]] = Counter()
        for letters, weight in corpus:
            for place in range(len(letters) - 1):
                pairs[letters[place], letters[place + 1]] += weight
        best = max(pairs, key=lambda pair: (pairs[pair], pair))
        merges.append(best)
        for letters, _ in corpus:
            for place in range(len(letters) - 2, -1, -1):
                if tuple(letters[place : place + 2]) == best:
                    letters[place : place + 2] = ["".join(best)]
    return vocabulary_of(merges), merges


def thousand_texts() -> list[str]:
    """Ordinary prompts, letters with many possible merges, odd pieces, all of Unicode, long texts."""
    rng = random.Random(11)
    texts = ["", " ", *ODD, "grass" * 100, "muddy path " * 200, "a" * 3000, END * 100, "草" * 500]
    while len(texts) < 200:
        texts.append("".join(rng.choices("abcde", k=rng.randint(2, 50))))
    while len(texts) < 450:
        texts.append(" ".join(rng.choices(ORDINARY, k=rng.randint(1, 12))))
    while len(texts) < 700:
        pieces = rng.choices([*ORDINARY, *ODD], k=rng.randint(1, 12))
        texts.append("".join(piece + rng.choice(["", "", " "]) for piece in pieces))
    while len(texts) < 1000:
        tops = rng.choices([0x80, 0x800, 0x3000, 0x20000, 0x110000], k=rng.randint(1, 25))
        codes = [rng.randrange(top) for top in tops]
        texts.append("".join(chr(code) for code in codes if not 0xD800 <= code < 0xE000))
    return texts


def tokenizer_of(
    vocabulary: dict[str, int], merges: list[tuple[str, str]], context: int = CONTEXT
) -> Tokenizer:
    return Tokenizer(vocabulary, merges, context, vocabulary[START], vocabulary[END])


def reference_of(vocabulary: dict[str, int], merges: list[tuple[str, str]], context: int = CONTEXT) -> Encode:
    """transformers' tokenizer with the same vocabulary."""
    from transformers import CLIPTokenizer

    made = CLIPTokenizer(vocab=dict(vocabulary), merges=list(merges))

    def encode(text: str) -> list[int]:
        ids: list[int] = made(text, truncation=True, max_length=context)["input_ids"]
        return ids

    return encode


def assert_same(ours: Tokenizer, reference: Encode, texts: list[str]) -> None:
    different = [ascii(text) for text in texts if ours.encode(text) != reference(text)]
    assert not different


def test_the_ids_of_a_thousand_texts_are_those_of_transformers(tmp_path: Path) -> None:
    vocabulary, merges = trained()
    assert len(merges) == 600
    reference = reference_of(vocabulary, merges)
    path = tmp_path / "tokenizer.json"
    save_tokenizer(path, vocabulary, merges, CONTEXT, vocabulary[START], vocabulary[END])
    texts = thousand_texts()
    assert len(texts) == 1000
    assert_same(Tokenizer.load(path), reference, texts)


@pytest.mark.parametrize("context", [3, 8, 5000])
def test_texts_are_cut_where_transformers_cuts_them(context: int) -> None:
    vocabulary, merges = trained()
    ours, reference = tokenizer_of(vocabulary, merges, context), reference_of(vocabulary, merges, context)
    assert_same(ours, reference, thousand_texts()[::5])


def test_merges_in_no_natural_order_and_symbols_that_are_missing_give_the_same_ids_too() -> None:
    vocabulary, merges = trained()
    shuffled = random.Random(3).sample(merges, len(merges))
    kept = [token for token in vocabulary if token not in {"a", "t</w>", "Ð", "!"}]
    fewer = {token: token_id for token_id, token in enumerate(kept)}
    possible = [(left, right) for left, right in shuffled if {left, right, left + right} <= fewer.keys()]
    texts = thousand_texts()[::3]
    assert_same(tokenizer_of(vocabulary, shuffled), reference_of(vocabulary, shuffled), texts)
    assert_same(tokenizer_of(fewer, possible), reference_of(fewer, possible), texts)


@settings(max_examples=200)
@given(text=st.text(max_size=60))
def test_any_text_has_the_ids_of_transformers(text: str) -> None:
    ours, reference = trained_pair()
    assert ours.encode(text) == reference(text)


@cache
def trained_pair() -> tuple[Tokenizer, Encode]:
    vocabulary, merges = trained()
    return tokenizer_of(vocabulary, merges), reference_of(vocabulary, merges)
