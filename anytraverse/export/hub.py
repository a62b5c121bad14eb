"""Where a checkpoint lies: in a folder on this disk, or on the Hugging Face hub, to be downloaded."""

from __future__ import annotations

import re
from pathlib import Path

from anytraverse.errors import BundleError

CONFIGS = ("config.json", "preprocessor_config.json")
TOKENIZER = ("vocab.json", "merges.txt", "tokenizer.json", "tokenizer_config.json", "special_tokens_map.json")
"""One of the tokenizer's two forms is enough: vocab.json with merges.txt, or tokenizer.json."""
WEIGHTS = ("model.safetensors", "pytorch_model.bin")
"""The first that is there is taken."""
CARD = "README.md"


def find_checkpoint(checkpoint: str, *, words: bool) -> tuple[Path, str]:
    """The folder of a checkpoint, and the revision of the hub that it is, "" for a folder of the user's own.

    words: whether a tokenizer belongs to it. Raises BundleError with what is missing and how to get it.
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
    except Exception as error:  # the hub's client has a dozen kinds of its own, and the network's
        kept = _kept(checkpoint)
        if kept is None or _missing(kept, words=words):
            raise BundleError(_remedy(checkpoint, type(error).__name__, words=words)) from error
        found = kept
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
    """From the hub, with the client's own progress bars; what was downloaded before is not again."""
    from huggingface_hub import HfApi, constants, snapshot_download

    # Asked first, for a download waits minutes for a network that swallows what is sent.
    there = {
        file.rfilename
        for file in HfApi().model_info(checkpoint, timeout=constants.HF_HUB_ETAG_TIMEOUT).siblings or ()
    }
    weights = [name for name in WEIGHTS if name in there][:1]
    return Path(snapshot_download(checkpoint, allow_patterns=[*CONFIGS, *TOKENIZER, CARD, *weights]))


def _kept(checkpoint: str) -> Path | None:
    """What an earlier download left. What else is needed is for the caller to look for."""
    from huggingface_hub import snapshot_download

    try:
        return Path(snapshot_download(checkpoint, allow_patterns=[*CONFIGS], local_files_only=True))
    except Exception:  # whatever it is, there is nothing to be had
        return None


def _remedy(checkpoint: str, why: str, *, words: bool) -> str:
    needed = [*CONFIGS, *(TOKENIZER[:2] if words else ()), " or ".join(WEIGHTS)]
    return (
        f"{checkpoint} is no folder here, and cannot be had from the hub ({why}): check the name and the "
        f"network. Or, on a computer with network: hf download {checkpoint} --local-dir "
        f"{checkpoint.split('/')[1]}; copy that folder here and give its path. Needed in it: "
        + ", ".join(needed)
    )
