"""Tokenizers of bundles: which texts become which ids, and files that are damaged or mean harm."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import PerceiverError
from anytraverse.export.random_weights import TINY, TINY_DENSE, random_clipseg, random_dense
from anytraverse.perception import tokenizer as tokenizer_module
from anytraverse.perception.tokenizer import SPACE, Tokenizer

CLIP = random_clipseg(TINY).tokenizer.encode()
SIGLIP, TIPSV2 = (random_dense(name, TINY_DENSE[name], 64).tokenizer.encode() for name in TINY_DENSE)
EACH = pytest.mark.parametrize("content", [CLIP, SIGLIP, TIPSV2], ids=["CLIP", "SigLIP 2", "TIPSv2"])


def tokens_of(content: bytes, text: str) -> list[str]:
    named = json.loads(content)["model"]["vocab"]
    names = {token_id: token for token, token_id in named.items()}
    return [names[token_id] for token_id in Tokenizer(content).encode(text)]


@EACH
def test_capitals_are_small_letters(content: bytes) -> None:
    tokenizer = Tokenizer(content)
    assert tokenizer.encode("A dirt PATH, ΟΔΟΣ") == tokenizer.encode("a dirt path, οδοσ")


def test_texts_are_split_as_clip_splits_them() -> None:
    start, *tokens, end = tokens_of(CLIP, " Ab\t12's")
    assert (start, end) == ("<|startoftext|>", "<|endoftext|>")
    assert tokens == ["a", "b</w>", "1</w>", "2</w>", "'", "s</w>"]
    assert tokens_of(CLIP, "e\u0301")[1:-1] == tokens_of(CLIP, "é")[1:-1] == ["Ã", "©</w>"]
    assert tokens_of(CLIP, "a<|endoftext|>")[1:-1] == ["a</w>", "<|endoftext|>"]
    assert tokens_of(CLIP, "") == ["<|startoftext|>", "<|endoftext|>"]


def test_texts_are_split_and_filled_up_as_sentencepiece_does_it() -> None:
    letters = [f"<0x{octet:02X}>" for octet in b"ab"]
    assert tokens_of(SIGLIP, "a B") == [letters[0], SPACE, letters[1], "<eos>", *["<pad>"] * 60]
    assert tokens_of(TIPSV2, "a  B") == [SPACE, letters[0], SPACE, letters[1]]
    assert tokens_of(TIPSV2, "草")[1:] == [f"<0x{octet:02X}>" for octet in "草".encode()]


@EACH
@settings(max_examples=50)
@given(text=st.text(max_size=200))
def test_any_text_has_ids_of_the_vocabulary_and_is_cut(content: bytes, text: str) -> None:
    tokenizer = Tokenizer(content)
    ids = tokenizer.encode(text)
    assert len(ids) <= (77 if content is CLIP else 64)
    assert max(ids, default=0) < tokenizer.size()


def test_a_long_text_is_cut_and_still_has_its_end() -> None:
    for content, end, most in ((CLIP, "<|endoftext|>", 77), (SIGLIP, "<eos>", 64)):
        tokens = tokens_of(content, "草 grass " * 1000)
        assert (len(tokens), tokens[-1]) == (most, end)


@EACH
def test_half_a_surrogate_pair_is_refused(content: bytes) -> None:
    with pytest.raises(PerceiverError, match="cannot be encoded"):
        Tokenizer(content).encode("grass \ud800")


def refusal(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    with pytest.raises(PerceiverError) as refused:
        Tokenizer.load(path)
    assert str(path) in str(refused.value)
    assert "anytraverse export" in str(refused.value)
    return str(refused.value)


@settings(max_examples=30)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_torn_file_is_refused(tmp_path_factory: pytest.TempPathFactory, share: float) -> None:
    refusal(tmp_path_factory.getbasetemp() / "torn.json", CLIP[: int(len(CLIP) * share)])


@given(st.binary(max_size=40))
def test_rubbish_is_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    refusal(tmp_path_factory.getbasetemp() / "rubbish.json", content)


@pytest.mark.parametrize(
    "content", [b"[" * 100_000, b'{"a":' * 100_000, b"[]", b"{}", b"null", b'{"model":{}}']
)
def test_a_foreign_file_is_refused(tmp_path: Path, content: bytes) -> None:
    assert "can be used" in refusal(tmp_path / "tokenizer.json", content)


def test_a_file_of_an_earlier_version_is_refused_with_what_to_do(tmp_path: Path) -> None:
    content = b'{"format":1,"context":77,"start":1,"end":2,"vocabulary":["a","b","c"],"merges":[]}'
    assert "an earlier version wrote it. Copy" in refusal(tmp_path / "tokenizer.json", content)


def test_a_file_that_is_missing_or_too_big_or_no_file_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tokenizer_module, "MAX_FILE_BYTES", len(CLIP) - 1)
    assert "more than" in refusal(tmp_path / "tokenizer.json", CLIP)
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", "missing"):
        with pytest.raises(PerceiverError, match="can be used"):
            Tokenizer.load(tmp_path / name)


def replace(step: Any, content: str) -> dict[str, Any]:
    return {"type": "Replace", "pattern": step, "content": content}


def sequence(kind: str, *steps: Any) -> dict[str, Any]:
    return {"type": "Sequence", kind: list(steps)}


BYTES = {"type": "ByteLevel", "add_prefix_space": False, "trim_offsets": True, "use_regex": True}
ENDLESS = {"type": "Split", "pattern": {"Regex": "(a+)+$"}, "behavior": "Isolated", "invert": False}
TWICE = {"type": "TemplateProcessing", "pair": [], "special_tokens": {}}
HARMFUL: dict[str, dict[str, Any]] = {
    "letters that become many, six times": {
        "normalizer": sequence("normalizers", *[replace({"String": "a"}, "a" * 100)] * 6)
    },
    "bytes that double sixty times": {"pre_tokenizer": sequence("pretokenizers", *[BYTES] * 60)},
    "a sequence in a sequence": {"normalizer": sequence("normalizers", sequence("normalizers"))},
    "an endless pattern": {"pre_tokenizer": ENDLESS},
    "an endless pattern that replaces": {"normalizer": replace({"Regex": "(a+)+$"}, " ")},
    "a table that is none": {"normalizer": {"type": "Precompiled", "precompiled_charsmap": "AAAA"}},
    "a table that leads astray": {
        "normalizer": {"type": "Precompiled", "precompiled_charsmap": "BAAAAP////8BAgME"}
    },
    "a padding of no token": {
        "padding": {
            "strategy": {"Fixed": 77},
            "direction": "Right",
            "pad_to_multiple_of": None,
            "pad_id": 10**6,
            "pad_type_id": 0,
            "pad_token": "a",
        }
    },
    "a terabyte of padding": {
        "padding": {
            "strategy": {"Fixed": 10**12},
            "direction": "Right",
            "pad_to_multiple_of": None,
            "pad_id": 0,
            "pad_type_id": 0,
            "pad_token": "a",
        }
    },
    "no end": {"truncation": None},
    "an end after a million": {
        "truncation": {"direction": "Right", "max_length": 10**6, "strategy": "LongestFirst", "stride": 0}
    },
    "steps wider than the text": {
        "truncation": {"direction": "Right", "max_length": 77, "strategy": "LongestFirst", "stride": 99}
    },
    "chance": {"model.dropout": 0.5},
    "a merge of no token": {"model.merges": [["a", "zz"]]},
    "ids that are none": {"model.vocab": {"a": -1}},
    "a model of another kind": {
        "model": {"type": "Unigram", "unk_id": 0, "vocab": [["a", -1.0]], "byte_fallback": False}
    },
    "nothing around the text": {"post_processor": None},
    "a token that is not there": {
        "post_processor": {**TWICE, "single": [{"SpecialToken": {"id": "X", "type_id": 0}}]}
    },
    "the text a thousand times": {
        "post_processor": {**TWICE, "single": [{"Sequence": {"id": "A", "type_id": 0}}] * 1000}
    },
}


@pytest.mark.parametrize("part", ["pre_tokenizer", "decoder"])
def test_patterns_that_would_fill_the_memory_are_refused_before_they_are_compiled(
    tmp_path: Path, part: str
) -> None:
    content = json.loads(CLIP)
    long = {"Regex": "[\\p{L}\\p{N}]" * 2000}
    split = {"type": "Split", "pattern": long, "behavior": "Removed", "invert": True}
    content[part] = split if part == "pre_tokenizer" else {"type": "Replace", "pattern": long, "content": ""}
    said = refusal(tmp_path / "tokenizer.json", json.dumps(content).encode())
    assert "its steps have more than 16384 characters" in said


@pytest.mark.parametrize("changes", HARMFUL.values(), ids=HARMFUL)
def test_what_would_cost_time_or_memory_or_fail_later_is_refused(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    content = json.loads(CLIP)
    for name, value in changes.items():
        outer, _, inner = name.rpartition(".")
        (content[outer] if outer else content)[inner] = value
    refusal(tmp_path / "tokenizer.json", json.dumps(content).encode())


LOADING = """
import os, sys
from anytraverse.perception import make_perceiver
from anytraverse.perception.tokenizer import Tokenizer
make_perceiver("builtin")
print("tokenizers" in sys.modules)
before = len(os.listdir("/proc/self/task"))
Tokenizer(sys.stdin.buffer.read()).encode("a muddy path")
print(len(os.listdir("/proc/self/task")) - before, "huggingface_hub" in sys.modules)
"""


def test_the_built_in_network_does_without_it_and_it_starts_no_thread_and_no_client_of_a_hub() -> None:
    command = [sys.executable, "-c", LOADING]
    done = subprocess.run(command, input=CLIP, capture_output=True, timeout=60, check=True)
    assert done.stdout.split() == [b"False", b"0", b"False"]


def test_without_the_package_it_is_said_what_to_type(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tokenizers", None)
    with pytest.raises(PerceiverError, match=r'tokenizers: .*pip install "anytraverse-companion\[words\]"'):
        Tokenizer(CLIP)
