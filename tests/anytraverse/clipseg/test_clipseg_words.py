"""Words become conditions: once each, however long, and only with a tokenizer and a table that fit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from anytraverse.errors import BundleError, PerceiverError
from anytraverse.export.random_weights import TINY, random_clipseg
from anytraverse.perception.clipseg.prompts import Prompts
from anytraverse.perception.runtime import Runtime

ONE = Runtime(threads=1)
TEXT = ["text-1", "text-2", "text-3"]


def prompts_of(bundle: Path, tokenizer: Path | None = None, table: Path | None = None) -> Prompts:
    pieces = [bundle / f"{piece}.onnx" for piece in TEXT]
    return Prompts(pieces, tokenizer or bundle / "tokenizer.json", table or bundle / "tokens.npy", ONE)


@pytest.fixture
def prompts(tiny: Path) -> Prompts:
    return prompts_of(tiny)


def test_each_word_has_its_own_condition_in_the_order_asked(prompts: Prompts) -> None:
    grass, mud, again = prompts.conditions(["grass", "mud", "grass"])
    assert grass.shape == (TINY.joint,)
    assert not np.array_equal(grass, mud)
    np.testing.assert_array_equal(grass, again)


def test_new_words_go_up_the_tower_together_and_known_ones_stay_down(
    prompts: Prompts, runs: list[str]
) -> None:
    words = ["grass", "mud", "sky"]
    prompts.conditions(words)
    assert runs == [piece for piece in TEXT for _ in words]
    runs.clear()
    prompts.conditions(["sky", "grass"])
    assert runs == []
    prompts.conditions(["sky", "rock"])
    assert runs == TEXT


def test_a_word_is_the_same_alone_and_in_company(tiny: Path) -> None:
    (alone,) = prompts_of(tiny).conditions(["gravel"])
    np.testing.assert_array_equal(prompts_of(tiny).conditions(["grass", "gravel", "a long word"])[1], alone)


@pytest.mark.parametrize(
    "text", ["", " ", "a" * 5000, "\U0001f3dc\ufe0f", "<|endoftext|>", "<|startoftext|>"]
)
def test_any_text_has_a_finite_condition(prompts: Prompts, text: str) -> None:
    (condition,) = prompts.conditions([text])
    assert np.isfinite(condition).all()


def test_of_a_long_text_what_the_network_can_read_counts(prompts: Prompts) -> None:
    shorter, longer, other = prompts.conditions(["a" * 75, "a" * 75 + " and more", "b" * 75])
    np.testing.assert_array_equal(shorter, longer)
    assert not np.array_equal(shorter, other)


@pytest.mark.slow
def test_the_words_used_last_are_kept(prompts: Prompts, runs: list[str]) -> None:
    prompts.conditions(["grass", "mud"])
    for number in range(255):
        prompts.conditions(["grass", f"thing {number}"])
    runs.clear()
    prompts.conditions(["grass", "thing 254"])
    assert runs == []
    prompts.conditions(["mud"])
    assert runs == TEXT


def test_more_words_at_once_than_are_kept_are_all_answered(prompts: Prompts) -> None:
    assert len(prompts.conditions([f"thing {number}" for number in range(300)])) == 300


@pytest.mark.parametrize(
    ("content", "reason"),
    [(np.zeros((4, 4)), "is no table of tokens"), (np.zeros(9, dtype=np.float32), "is no table of tokens")],
)
def test_a_table_of_another_kind_is_refused(tiny: Path, tmp_path: Path, content: object, reason: str) -> None:
    np.save(tmp_path / "tokens.npy", np.asarray(content))
    with pytest.raises(BundleError, match=reason):
        prompts_of(tiny, table=tmp_path / "tokens.npy")


@pytest.mark.parametrize("data", [b"", b"not a table", b"\x93NUMPY\x01\x00", b"PK\x05\x06" + bytes(18)])
def test_a_table_that_cannot_be_read_is_refused(tiny: Path, tmp_path: Path, data: bytes) -> None:
    (tmp_path / "tokens.npy").write_bytes(data)
    with pytest.raises(BundleError, match=r"tokens\.npy cannot be read"):
        prompts_of(tiny, table=tmp_path / "tokens.npy")


def test_a_table_that_would_run_code_is_not_read(tiny: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "tokens.npy", np.array([print], dtype=object), allow_pickle=True)
    with pytest.raises(BundleError, match="cannot be read"):
        prompts_of(tiny, table=tmp_path / "tokens.npy")


def test_a_tokenizer_with_more_tokens_than_the_table_is_refused(tiny: Path, tmp_path: Path) -> None:
    content = random_clipseg(TINY).tokenizer.replace("513", "514")
    (tmp_path / "tokenizer.json").write_text(content)
    with pytest.raises(BundleError, match="knows more tokens than the network"):
        prompts_of(tiny, tokenizer=tmp_path / "tokenizer.json").conditions(["grass"])


def test_a_tokenizer_that_makes_nothing_of_a_text_fails_as_a_perceiver_does(
    tiny: Path, tmp_path: Path
) -> None:
    content = json.loads(random_clipseg(TINY).tokenizer)
    bare = [{"Sequence": {"id": "A", "type_id": 0}}]
    content["post_processor"] = {
        "type": "TemplateProcessing",
        "single": bare,
        "pair": [],
        "special_tokens": {},
    }
    (tmp_path / "tokenizer.json").write_text(json.dumps(content))
    with pytest.raises(PerceiverError, match="the network failed"):
        prompts_of(tiny, tokenizer=tmp_path / "tokenizer.json").conditions([""])


def test_a_text_network_of_another_size_fails_as_a_perceiver_does(tiny: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "tokens.npy", np.zeros((514, 7), dtype=np.float32))
    with pytest.raises(PerceiverError, match="the network failed"):
        prompts_of(tiny, table=tmp_path / "tokens.npy").conditions(["grass"])
