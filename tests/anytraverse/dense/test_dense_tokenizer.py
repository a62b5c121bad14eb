"""The tokenizer of dense models, against a plain one and against rubbish."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from anytraverse.errors import PerceiverError
from anytraverse.perception.dense.tokenizer import Rules, Tokenizer, save_tokenizer

IDS = {f"<0x{octet:02X}>": octet for octet in range(256)} | {
    token: 256 + index for index, token in enumerate(["▁", *"abcde", "<pad>", "<eos>"])
}
PAIRS = [("a", "b"), ("▁", "a"), ("ab", "c"), ("▁a", "b"), ("c", "c"), ("cc", "c"), ("d", "ab"), ("b", "a")]
for left, right in PAIRS:
    IDS.setdefault(left + right, len(IDS))
PAD, EOS = IDS["<pad>"], IDS["<eos>"]
WHOLE = Rules(
    context=16, lower=True, compose=False, split=False, before=(), after=(EOS,), pad=PAD, pad_left=False
)
SPLIT = replace(WHOLE, compose=True, split=True, before=(EOS,), after=(), pad=-1)


def plain(text: str) -> list[int]:
    """Byte-pair encoding as a textbook has it: one merge after the other, in order of rank."""
    parts = [[one] if one in IDS else [f"<0x{octet:02X}>" for octet in one.encode()] for one in text]
    tokens = [token for part in parts for token in part]
    while True:
        pairs = list(pairwise(tokens))
        known = [pair for pair in PAIRS if pair in pairs]
        if not known:
            return [IDS[token] for token in tokens]
        place = pairs.index(known[0])
        tokens[place : place + 2] = ["".join(known[0])]


@given(st.text("abcde ", max_size=14) | st.text("abé草\u0301 ", max_size=5))
def test_ids_are_those_of_the_textbook(text: str) -> None:
    expected = [*plain(text.lower().replace(" ", "▁"))[:15], EOS]
    assert Tokenizer(IDS, PAIRS, WHOLE).encode(text) == expected + [PAD] * (16 - len(expected))


@given(st.text(max_size=60))
def test_any_text_has_ids_within_the_context(text: str) -> None:
    try:
        text.encode()
    except UnicodeEncodeError:
        return
    for rules in (WHOLE, SPLIT, replace(WHOLE, lower=False, split=True, pad_left=True)):
        ids = Tokenizer(IDS, PAIRS, rules).encode(text)
        assert len(ids) == 16 if rules.pad >= 0 else len(ids) <= 16
        assert set(ids) <= set(IDS.values())


def test_padding_stands_where_the_model_wants_it() -> None:
    left = replace(WHOLE, context=6, split=True, pad_left=True)
    assert Tokenizer(IDS, PAIRS, left).encode("ab") == [PAD, PAD, PAD, IDS["▁"], IDS["ab"], EOS]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text("abcde XYZ", max_size=20))
def test_what_is_saved_encodes_the_same(tmp_path: Path, text: str) -> None:
    path = tmp_path / "tokenizer.json"
    if not path.exists():
        save_tokenizer(path, IDS, PAIRS, SPLIT)
    assert Tokenizer.load(path).encode(text) == Tokenizer(IDS, PAIRS, SPLIT).encode(text)


@pytest.mark.parametrize(
    "change",
    [
        {"format": 2},
        {"format": "1"},
        {"more": 1},
        {"vocabulary": {}},
        {"vocabulary": []},
        {"vocabulary": ["a"]},
        {"vocabulary": ["a", "a"]},
        {"vocabulary": [1]},
        {"merges": [1]},
        {"merges": [0, 100000]},
        {"merges": [0, 1]},
        {"merges": [0, True]},
        {"merges": "ab"},
        {"rules": {}},
        {"rules": None},
        {"rules.context": 1},
        {"rules.context": True},
        {"rules.lower": 1},
        {"rules.before": [100000]},
        {"rules.before": [-1]},
        {"rules.after": 3},
        {"rules.after": [1] * 16},
        {"rules.pad": 100000},
        {"rules.pad": -2},
    ],
)
def test_rubbish_is_refused_with_a_remedy(tmp_path: Path, change: dict[str, Any]) -> None:
    path = tmp_path / "tokenizer.json"
    save_tokenizer(path, IDS, PAIRS, WHOLE)
    content = json.loads(path.read_text())
    for name, value in change.items():
        outer, _, inner = name.partition(".")
        if inner:
            content[outer][inner] = value
        else:
            content[outer] = value
    path.write_text(json.dumps(content))
    with pytest.raises(PerceiverError, match=r"is not a tokenizer that can be used: .* Copy the bundle"):
        Tokenizer.load(path)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=40) | st.just(b"[" * 100000))
def test_files_of_rubbish_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "tokenizer.json"
    path.write_bytes(content)
    with pytest.raises(PerceiverError, match="is not a tokenizer"):
        Tokenizer.load(path)
