"""Finds a checkpoint in a folder on this disk, or downloads it from the Hugging Face hub."""

from __future__ import annotations

import re
from pathlib import Path

from anytraverse.errors import BundleError

CONFIGS = ("config.json", "preprocessor_config.json")
TOKENIZER = ("vocab.json", "merges.txt", "tokenizer.json", "tokenizer_config.json", "special_tokens_map.json")
"""One of the tokenizer's two forms is enough: vocab.json with merges.txt, or tokenizer.json."""
WEIGHTS = ("model.safetensors", "pytorch_model.bin")
"""The first file that exists is used."""
CARD = "README.md"


def find_checkpoint(checkpoint: str, *, words: bool) -> tuple[Path, str]:
    """Return the folder of a checkpoint and its revision on the hub; "" for a folder of the user's own.

    words: whether it must have a tokenizer. Raises BundleError, which says what is missing and how to get it.
    """
    folder = Path(checkpoint).expanduser()
    if folder.is_dir():
        if missing := _missing(folder, words=words):
            raise BundleError(f"{folder} lacks {', '.join(missing)}: copy the whole checkpoint")
        return folder, ""
    if not re.fullmatch(r"\w[\w.-]*/\w[\w.-]*", checkpoint):
        raise BundleError(f"{checkpoint} is no folder: give one, or an id of the hub like owner/name")
    try:
        found = _download(checkpoint)
    except Exception as error:  # the hub's client raises many classes of its own, and those of the network
        downloaded = _cached_folder(checkpoint)
        if downloaded is None or _missing(downloaded, words=words):
            raise BundleError(_remedy(checkpoint, type(error).__name__, words=words)) from error
        found = downloaded
    if missing := _missing(found, words=words):
        raise BundleError(f"the hub's {checkpoint} lacks {', '.join(missing)}: give another checkpoint")
    return found, found.name


def _missing(folder: Path, *, words: bool) -> list[str]:
    there = {path.name for path in folder.iterdir() if path.is_file()}
    missing = [name for name in CONFIGS if name not in there]
    if there.isdisjoint(WEIGHTS):
        missing.append(" or ".join(WEIGHTS))
    if words and "tokenizer.json" not in there:
        missing += [name for name in TOKENIZER[:2] if name not in there]
    return missing


def _download(checkpoint: str) -> Path:
    """Download a checkpoint from the hub, or take it from the client's cache; shows the client's progress."""
    from huggingface_hub import HfApi, constants, snapshot_download

    # The hub is asked first, with a timeout: a download would wait minutes on a network that drops packets.
    there = {
        file.rfilename
        for file in HfApi().model_info(checkpoint, timeout=constants.HF_HUB_ETAG_TIMEOUT).siblings or ()
    }
    weights = [name for name in WEIGHTS if name in there][:1]
    return Path(snapshot_download(checkpoint, allow_patterns=[*CONFIGS, *TOKENIZER, CARD, *weights]))


def _cached_folder(checkpoint: str) -> Path | None:
    """Return the folder of an earlier download, or None. The caller must check that it is complete."""
    from huggingface_hub import snapshot_download

    try:
        return Path(snapshot_download(checkpoint, allow_patterns=[*CONFIGS], local_files_only=True))
    except Exception:  # for any reason: nothing usable is cached
        return None


def _remedy(checkpoint: str, why: str, *, words: bool) -> str:
    tokens = [f"tokenizer.json (CLIPSeg: or {' and '.join(TOKENIZER[:2])})"] if words else []
    needed = [*CONFIGS, *tokens, " or ".join(WEIGHTS)]
    return (
        f"{checkpoint} is no folder here, and cannot be had from the hub ({why}): check the name and the "
        f"network. Or, on a computer with network: hf download {checkpoint} --local-dir "
        f"{checkpoint.split('/')[1]}; copy that folder here and give its path. Needed in it: "
        + ", ".join(needed)
    )
