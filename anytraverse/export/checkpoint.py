"""Reading checkpoints with transformers: a folder on this disk, or an id on the Hugging Face hub."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from anytraverse.errors import BundleError
from anytraverse.export.architecture import architecture, vision_architecture
from anytraverse.export.making import ClipSegCheckpoint, SceneCheckpoint, Vocabulary
from anytraverse.perception.resizing import Fit

_FILTERS = {2: "bilinear", 3: "bicubic"}
"""Pillow's numbers of filters, as preprocessor_config.json gives them."""
_CONFIGS = ["config.json", "preprocessor_config.json"]
_TOKENIZER = [
    "vocab.json",
    "merges.txt",
    "tokenizer.json",
    "tokenizer_config.json",
    "special_tokens_map.json",
]
_WEIGHTS = ["model.safetensors", "pytorch_model.bin"]


def load_clipseg(checkpoint: str) -> ClipSegCheckpoint:
    """A CLIPSeg checkpoint. Raises BundleError with what to do: no network, a file missing, another model."""
    from transformers import CLIPSegConfig, CLIPSegForImageSegmentation

    folder, revision = find_checkpoint(checkpoint, [*_CONFIGS, *_TOKENIZER, "README.md"])
    stated = _read_json(folder / "config.json")
    if stated.get("model_type") != "clipseg":
        raise BundleError(
            f'{checkpoint} is a checkpoint of "{stated.get("model_type")}", not of clipseg: '
            "give one like CIDAS/clipseg-rd64-refined"
        )
    preprocessor = _read_json(folder / "preprocessor_config.json")
    config = CLIPSegConfig.from_pretrained(folder).to_dict()
    weights = _load_weights(CLIPSegForImageSegmentation, folder, checkpoint)
    vocabulary = _load_vocabulary(folder, checkpoint)
    _check_end(config["text_config"]["eos_token_id"], vocabulary)
    return ClipSegCheckpoint(
        architecture(config, preprocessor),
        weights,
        _filter(preprocessor, checkpoint),
        vocabulary,
        _describe(checkpoint, folder, revision),
    )


def load_scene(checkpoint: str) -> SceneCheckpoint:
    """The image encoder of a CLIP checkpoint. Raises BundleError as `load_clipseg`."""
    from transformers import CLIPConfig, CLIPVisionModelWithProjection

    folder, revision = find_checkpoint(checkpoint, [*_CONFIGS, "README.md"])
    stated = _read_json(folder / "config.json")
    if stated.get("model_type") != "clip":
        raise BundleError(
            f'{checkpoint} is a checkpoint of "{stated.get("model_type")}", not of clip: '
            "give one like openai/clip-vit-base-patch32"
        )
    preprocessor = _read_json(folder / "preprocessor_config.json")
    config = CLIPConfig.from_pretrained(folder).to_dict()
    side = config["vision_config"]["image_size"]
    return SceneCheckpoint(
        vision_architecture(config["vision_config"], preprocessor),
        _load_weights(CLIPVisionModelWithProjection, folder, checkpoint),
        Fit(side, side, _filter(preprocessor, checkpoint), crop=True),
        _describe(checkpoint, folder, revision),
    )


def find_checkpoint(checkpoint: str, files: list[str]) -> tuple[Path, str]:
    """The folder of a checkpoint, downloaded where it is an id of the hub, and its revision."""
    folder = Path(checkpoint).expanduser()
    if folder.is_dir():
        missing = [name for name in _CONFIGS if not (folder / name).is_file()]
        if not any((folder / name).is_file() for name in _WEIGHTS):
            missing.append(" or ".join(_WEIGHTS))
        if missing:
            raise BundleError(f"{folder} lacks {', '.join(missing)}: copy the whole checkpoint")
        return folder, ""
    if checkpoint.count("/") != 1 or checkpoint.startswith((".", "/", "~")):
        raise BundleError(f"{checkpoint} is no folder: give one, or an id of the hub like owner/name")
    from huggingface_hub import snapshot_download

    try:
        found = Path(snapshot_download(checkpoint, allow_patterns=[*files, _WEIGHTS[0]]))
        if not (found / _WEIGHTS[0]).is_file():
            found = Path(snapshot_download(checkpoint, allow_patterns=[*files, _WEIGHTS[1]]))
    except Exception as error:  # the hub's client has a dozen kinds of its own, and the network's
        raise BundleError(
            f"{checkpoint} cannot be had from the hub ({type(error).__name__}). On a computer with network: "
            f"hf download {checkpoint} --local-dir {checkpoint.split('/')[1]}; copy that folder here, give "
            f"its path. Needed in it: {', '.join(files)}, {' or '.join(_WEIGHTS)}"
        ) from error
    return find_checkpoint(str(found), files)[0], found.name


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise BundleError(f"{path} cannot be read ({error}): copy the checkpoint again") from None
    if not isinstance(content, dict):
        raise BundleError(f"{path} holds no JSON object: copy the checkpoint again")
    return content


def _load_weights(kind: Any, folder: Path, checkpoint: str) -> Mapping[str, Any]:
    try:
        model, info = kind.from_pretrained(folder, output_loading_info=True, local_files_only=True)
    except Exception as error:  # safetensors, pickle, torch and transformers have many kinds
        why = " ".join(str(error).split())[:300]
        raise BundleError(f"the weights of {checkpoint} cannot be loaded ({why}): copy them again") from error
    if info["missing_keys"]:
        some = ", ".join(sorted(info["missing_keys"])[:3])
        raise BundleError(f"{checkpoint} lacks weights ({some}, ...): it is no {kind.__name__}")
    return {
        name: value.float().numpy() for name, value in model.state_dict().items() if value.is_floating_point()
    }


def _load_vocabulary(folder: Path, checkpoint: str) -> Vocabulary:
    from transformers import CLIPTokenizerFast

    try:
        tokenizer = CLIPTokenizerFast.from_pretrained(folder, local_files_only=True)
        model = json.loads(tokenizer.backend_tokenizer.to_str())["model"]
    except Exception as error:
        raise BundleError(
            f"{checkpoint} has no CLIP tokenizer (vocab.json and merges.txt): {error}"
        ) from error
    merges = [_pair(merge) for merge in model["merges"]]
    return Vocabulary(model["vocab"], merges, tokenizer.bos_token_id, tokenizer.eos_token_id)


def _pair(merge: str | list[str]) -> tuple[str, str]:
    """Older tokenizers write a merge as one string."""
    left, right = merge.split(" ") if isinstance(merge, str) else merge
    return left, right


def _check_end(stated: int, vocabulary: Vocabulary) -> None:
    """A text is read at its end. Old checkpoints state 2 for it and mean the highest id (transformers)."""
    expected = max(vocabulary.ids.values()) if stated == 2 else stated
    if vocabulary.end != expected:
        raise BundleError(
            f"the checkpoint ends a text with token {expected}, its tokenizer with {vocabulary.end}: "
            "they do not belong together, copy the checkpoint again"
        )


def _filter(preprocessor: Mapping[str, Any], checkpoint: str) -> str:
    number = preprocessor.get("resample", 2)
    if number not in _FILTERS:
        raise BundleError(
            f"{checkpoint} resizes with filter {number!r}: only 2 (bilinear) and 3 (bicubic) are known"
        )
    return _FILTERS[number]


def _describe(checkpoint: str, folder: Path, revision: str) -> dict[str, str]:
    described = {"weights": checkpoint if revision else folder.resolve().name, "licence": _licence(folder)}
    return described | ({"revision": revision} if revision else {})


def _licence(folder: Path) -> str:
    """What the model card's front matter says, if anything."""
    try:
        card = (folder / "README.md").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return "not stated in the checkpoint: see its page"
    for line in card.splitlines()[:40]:
        key, _, value = line.partition(":")
        if key.strip() == "license" and value.strip():
            return value.strip()
    return "not stated in the checkpoint: see its page"
