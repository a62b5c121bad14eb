"""Makes a bundle's tokenizer.json of the tokenizer of a checkpoint, with transformers."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from anytraverse.errors import BundleError
from anytraverse.perception.tokenizer import LOWER, Tokenizer


def clip_tokenizer(folder: Path, context: int, end: int) -> str:
    """Load the tokenizer of a CLIPSeg, and cut texts to `context` tokens. Raises BundleError.

    end: the id that ends a text, as the checkpoint states it. Old ones state 2 and mean the highest id, as
    transformers knows.
    """
    from transformers import CLIPTokenizerFast

    with _readable(folder), quietly():
        theirs = CLIPTokenizerFast.from_pretrained(folder, local_files_only=True)
        backend = theirs.backend_tokenizer
        backend.enable_truncation(context)
        backend.no_padding()
        content: str = backend.to_str()
        model = json.loads(content)["model"]
        orphans = _orphans(model, theirs.all_special_tokens)
    if orphans:
        raise BundleError(
            f"the tokenizer in {folder} has tokens that no merge makes ({orphans[0]!r}): "
            "merges.txt is torn, copy it again"
        )
    expected = max(model["vocab"].values()) if end == 2 else end
    if theirs.eos_token_id != expected:
        raise BundleError(
            f"the checkpoint ends a text with token {expected}, its tokenizer with {theirs.eos_token_id}: "
            "they do not belong together, copy the checkpoint again"
        )
    return content


def dense_tokenizer(folder: Path, family: str, context: int, texts: Sequence[str]) -> str:
    """Load the tokenizer of a dense model, and cut texts to `context` tokens; SigLIP's are filled up to it.

    Raises BundleError, also when it would not give the ids of transformers for `texts`.
    """
    siglip = family == "siglip"
    with _readable(folder):
        theirs = _open(folder)
        given: dict[str, Any] = {"truncation": True, "max_length": context}
        if siglip:
            given["padding"] = "max_length"
        expected = [theirs(text.lower() if siglip else text, **given)["input_ids"] for text in texts]
        # the backend keeps how the last text was cut and filled up
        content = json.loads(theirs.backend_tokenizer.to_str())
    steps = content["normalizer"] or {"type": "Sequence", "normalizers": []}
    steps = steps["normalizers"] if steps["type"] == "Sequence" else [steps]
    # in place of a table of the model's own, which could replace a character by megabytes
    steps = [{"type": "NFKC"} if step["type"] == "Precompiled" else step for step in steps]
    if siglip and LOWER not in steps:  # SigLIP 2 was trained on lower case
        steps.insert(0, LOWER)
    content["normalizer"] = {"type": "Sequence", "normalizers": steps}
    made = json.dumps(content, ensure_ascii=False, separators=(",", ":"))
    try:
        ours = Tokenizer(made.encode())
    except ValueError as error:
        raise BundleError(
            f"the tokenizer in {folder} cannot be exported: {error}. SigLIP 2 and TIPSv2 have one that can"
        ) from error
    for text, ids in zip(texts, expected, strict=True):
        if ours.encode(text) != ids:
            raise BundleError(
                f'the tokenizer in {folder} splits "{text}" in a way that this program cannot: '
                "give another checkpoint"
            )
    return made


def _open(folder: Path) -> Any:
    from transformers import AutoTokenizer, PreTrainedTokenizerFast

    with quietly():
        try:
            return AutoTokenizer.from_pretrained(folder, local_files_only=True)
        except Exception:  # an older class may need sentencepiece, and tokenizer.json does not
            return PreTrainedTokenizerFast.from_pretrained(folder, local_files_only=True)


def _orphans(model: dict[str, Any], special: Sequence[str]) -> list[str]:
    """Return tokens that no merge makes. Only these reveal a merges.txt that was cut off at a line's end."""
    # older tokenizers write a merge as one string
    pairs = (merge.split(" ") if isinstance(merge, str) else merge for merge in model["merges"])
    made = {left + right for left, right in pairs} | set(special)
    return [token for token in model["vocab"] if len(token.removesuffix("</w>")) > 1 and token not in made]


@contextmanager
def _readable(folder: Path) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # tokenizers and transformers raise many classes
        why = " ".join(str(error).split())[:300]
        raise BundleError(f"the tokenizer in {folder} cannot be loaded ({why}): copy it again") from error


@contextmanager
def quietly() -> Iterator[None]:
    """Suppress the progress bars and tables of transformers, and with them those of downloads."""
    from transformers.utils import logging

    before = logging.get_verbosity()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        logging.enable_progress_bar()
        logging.set_verbosity(before)
