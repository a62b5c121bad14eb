"""Reads the tokenizer of a dense model, and proves that ours gives the same ids."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from anytraverse.errors import BundleError
from anytraverse.export.checkpoint import pair_of, quietly
from anytraverse.export.dense_making import DenseVocabulary
from anytraverse.perception.dense.tokenizer import SPACE, Rules, Tokenizer


def load_vocabulary(folder: Path, family: str, context: int, texts: Sequence[str]) -> DenseVocabulary:
    """Load the tokenizer of a checkpoint.

    Raises BundleError for one of another kind, and when it does not give the ids of transformers for `texts`.
    """
    try:
        theirs = _open(folder)
        backend = json.loads(theirs.backend_tokenizer.to_str())
        words = _vocabulary(theirs, backend, family, context)
        ours = Tokenizer(words.ids, words.merges, words.rules)
    except BundleError as error:
        raise BundleError(f"{folder}: {error}") from None
    except Exception as error:  # tokenizers and transformers raise many classes
        why = " ".join(str(error).split())[:300]
        raise BundleError(f"the tokenizer in {folder} cannot be loaded ({why}): copy it again") from error
    for text in texts:
        expected = _ids(theirs, text.lower() if words.rules.lower else text, words.rules)
        if ours.encode(text) != expected:
            raise BundleError(
                f'the tokenizer in {folder} splits "{text}" in a way that this program cannot: '
                "give another checkpoint"
            )
    return words


def _open(folder: Path) -> Any:
    from transformers import AutoTokenizer, PreTrainedTokenizerFast

    with quietly():
        try:
            return AutoTokenizer.from_pretrained(folder, local_files_only=True)
        except Exception:  # an older class may need sentencepiece, and tokenizer.json does not
            return PreTrainedTokenizerFast.from_pretrained(folder, local_files_only=True)


def _vocabulary(theirs: Any, backend: dict[str, Any], family: str, context: int) -> DenseVocabulary:
    model, before = backend["model"], json.dumps(backend["pre_tokenizer"])
    normalizer = json.dumps(backend["normalizer"], ensure_ascii=False)
    if model["type"] != "BPE" or not model["byte_fallback"]:
        raise BundleError(
            f"its tokenizer is {model['type']}, and only BPE with byte fallback can be exported: "
            "SigLIP 2 and TIPSv2 have it, the first SigLIP has not"
        )
    split = '"Metaspace"' in before
    if not split and f'"content": "{SPACE}"' not in normalizer:
        raise BundleError(
            "its tokenizer does not write a space as SentencePiece does: give another checkpoint"
        )
    bare, whole = (theirs("a", add_special_tokens=added)["input_ids"] for added in (False, True))
    start = next((at for at in range(len(whole) - len(bare) + 1) if whole[at : at + len(bare)] == bare), None)
    if start is None or (family == "siglip" and theirs.pad_token_id is None):
        raise BundleError("its tokenizer has no padding, or changes a text's ids: give another checkpoint")
    rules = Rules(
        context=context,
        lower=family == "siglip" or '"Lowercase"' in normalizer,  # SigLIP 2 was trained on lower case
        compose='"Precompiled"' in normalizer or '"NFKC"' in normalizer,
        split=split,
        before=tuple(whole[:start]),
        after=tuple(whole[start + len(bare) :]),
        pad=theirs.pad_token_id if family == "siglip" else -1,
        pad_left=theirs.padding_side == "left",
    )
    ids = dict(model["vocab"])
    named = {token_id: token for token, token_id in ids.items()}
    for token_id in (*rules.before, *rules.after, rules.pad):
        if token_id >= 0 and token_id not in named:
            ids[theirs.convert_ids_to_tokens(token_id)] = token_id
    return DenseVocabulary(ids, [pair_of(merge) for merge in model["merges"]], rules)


def _ids(theirs: Any, text: str, rules: Rules) -> list[int]:
    filled = {"padding": "max_length"} if rules.pad >= 0 else {}
    ids: list[int] = theirs(text, truncation=True, max_length=rules.context, **filled)["input_ids"]
    return ids
