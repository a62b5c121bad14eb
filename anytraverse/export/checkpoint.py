"""Reads checkpoints with transformers."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from anytraverse.errors import BundleError
from anytraverse.export.architecture import architecture, vision_architecture
from anytraverse.export.hub import CARD, CONFIGS, find_checkpoint
from anytraverse.export.making import ClipSegCheckpoint, SceneCheckpoint
from anytraverse.export.tokens import clip_tokenizer, quietly
from anytraverse.perception.resizing import Fit

_FILTERS = {2: "bilinear", 3: "bicubic"}
"""Pillow's numbers of filters, as preprocessor_config.json gives them."""
_UNSTATED = "not stated in the checkpoint: see its page"


def model_type(checkpoint: str) -> str:
    """Return the kind of model that a checkpoint states, e.g. "clipseg"; "" if none. Raises BundleError."""
    folder, _ = find_checkpoint(checkpoint, words=True)
    return str(read_json(folder / CONFIGS[0]).get("model_type", ""))


def load_clipseg(checkpoint: str) -> ClipSegCheckpoint:
    """Load a CLIPSeg checkpoint: a folder, or an id of the hub.

    Raises BundleError without a network, for a missing or damaged file, and for another model.
    """
    from transformers import CLIPSegConfig, CLIPSegForImageSegmentation

    folder, revision = find_checkpoint(checkpoint, words=True)
    config, preprocessor = read_configs(folder, CLIPSegConfig, "CIDAS/clipseg-rd64-refined")
    with stated_in(folder):
        arch = architecture(config, preprocessor)
        tokenizer = clip_tokenizer(folder, arch.text.context, config["text_config"]["eos_token_id"])
    return ClipSegCheckpoint(
        arch,
        load_weights(CLIPSegForImageSegmentation, folder),
        resize_filter(preprocessor, folder),
        tokenizer,
        describe(checkpoint, folder, revision),
    )


def load_scene(checkpoint: str) -> SceneCheckpoint:
    """Load the image encoder of a CLIP checkpoint. Raises BundleError as `load_clipseg`."""
    from transformers import CLIPConfig, CLIPVisionModelWithProjection

    folder, revision = find_checkpoint(checkpoint, words=False)
    config, preprocessor = read_configs(folder, CLIPConfig, "openai/clip-vit-base-patch32")
    with stated_in(folder):
        vision = vision_architecture(config["vision_config"], preprocessor)
        side = config["vision_config"]["image_size"]
        fit = Fit(side, side, resize_filter(preprocessor, folder), crop=True)
    return SceneCheckpoint(
        vision,
        load_weights(CLIPVisionModelWithProjection, folder),
        fit,
        describe(checkpoint, folder, revision),
    )


def read_configs(folder: Path, kind: Any, like: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the model's config with defaults filled in, and the preprocessor's config as in its file."""
    stated, preprocessor = (read_json(folder / name) for name in CONFIGS)
    if stated.get("model_type") != kind.model_type:
        raise BundleError(
            f'{folder} is a checkpoint of "{stated.get("model_type")}", not of {kind.model_type}: '
            f"give one like {like}"
        )
    with stated_in(folder), quietly():
        config: dict[str, Any] = kind.from_pretrained(folder, local_files_only=True).to_dict()
    return config, preprocessor


def read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise BundleError(f"{path} cannot be read ({error}): copy the checkpoint again") from None
    if not isinstance(content, dict):
        raise BundleError(f"{path} holds no JSON object: copy the checkpoint again")
    return content


def load_weights(kind: Any, folder: Path) -> Mapping[str, Any]:
    try:
        with quietly():
            model, info = kind.from_pretrained(folder, output_loading_info=True, local_files_only=True)
    except Exception as error:  # safetensors, pickle, torch and transformers raise many classes
        why = " ".join(str(error).split())[:300]
        raise BundleError(f"the weights in {folder} cannot be loaded ({why}): copy them again") from error
    if info["missing_keys"]:
        some = ", ".join(sorted(info["missing_keys"])[:3])
        raise BundleError(f"{folder} lacks weights ({some}, ...): give a whole {kind.__name__}")
    return {
        name: value.float().numpy() for name, value in model.state_dict().items() if value.is_floating_point()
    }


def resize_filter(
    preprocessor: Mapping[str, Any], folder: Path, default: int = 2, *, normalised: bool = True
) -> str:
    """Return the filter with which the checkpoint resizes. Raises BundleError for unusual preprocessing.

    default: where none is stated. normalised: whether pixels have to be normalised after scaling, or not.
    """
    number = preprocessor.get("resample", default)
    if number not in _FILTERS:
        raise BundleError(
            f"{folder} resizes with filter {number!r}: only 2 (bilinear) and 3 (bicubic) are known"
        )
    steps = all(preprocessor.get(step, True) for step in ("do_resize", "do_rescale"))
    steps = steps and bool(preprocessor.get("do_normalize", normalised)) == normalised
    if not steps or abs(255 * preprocessor.get("rescale_factor", 1 / 255) - 1) > 1e-6:
        raise BundleError(
            f"{folder / CONFIGS[1]} leaves pixels unscaled or scales them otherwise than by 1/255: "
            "such a checkpoint cannot be exported"
        )
    return _FILTERS[number]


@contextmanager
def stated_in(folder: Path) -> Iterator[None]:
    """Turn any error about a missing or wrong value in a config into a BundleError."""
    try:
        yield
    except BundleError:
        raise
    except Exception as error:  # transformers checks configs in ways that change with its versions
        why = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise BundleError(
            f"{' or '.join(CONFIGS)} in {folder} is not as it must be ({why}): copy the checkpoint again"
        ) from error


def describe(checkpoint: str, folder: Path, revision: str) -> dict[str, str]:
    described = {"weights": checkpoint if revision else folder.resolve().name, "licence": _licence(folder)}
    return described | ({"revision": revision} if revision else {})


def _licence(folder: Path) -> str:
    """Return the licence in the model card's front matter, if there is one."""
    try:
        card = (folder / CARD).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return _UNSTATED
    for line in card.splitlines()[:40]:
        key, _, value = line.partition(":")
        if key.strip() == "license" and value.strip():
            return value.strip()
    return _UNSTATED
