"""Tiny SigLIP 2 and TIPSv2 of random weights, as transformers saves them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.clipseg.checkpoints import quieten_transformers
from tests.anytraverse.export.checkpoints import merged, redraw, write_json

LETTERS = "▁abcdefghijklmnopqrstuvwxyz.,'!0123456789-"
MERGES = [
    *(("▁", "a"), ("a", "t"), ("t", "o"), ("p", "h"), ("o", "f"), ("▁", "p"), ("▁p", "h"), ("r", "a")),
    *(("s", "s"), ("ph", "o"), ("ra", "ss"), ("g", "rass"), ("▁ph", "oto"), ("o", "to"), ("▁", "g")),
    *(("▁a", "▁"), ("e", "e"), ("▁", "of"), ("t", "h"), ("▁g", "rass"), ("d", "o"), ("o", "o")),
]
TEXT = {
    "hidden_size": 32,
    "intermediate_size": 64,
    "num_hidden_layers": 3,
    "num_attention_heads": 2,
    "max_position_embeddings": 64,
    "bos_token_id": 2,
    "eos_token_id": 1,
    "pad_token_id": 0,
}
SIGLIP: dict[str, Any] = {
    "text_config": TEXT,
    "vision_config": {
        "hidden_size": 32,
        "intermediate_size": 64,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "image_size": 64,
        "patch_size": 8,
    },
}
TIPSV2: dict[str, Any] = {
    "text_config": TEXT,
    "vision_config": {
        "hidden_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "mlp_ratio": 2,
        "image_size": 64,
        "patch_size": 8,
    },
}
SIGLIP_IMAGES = {
    "image_processor_type": "SiglipImageProcessor",
    "do_resize": True,
    "do_rescale": True,
    "do_normalize": True,
    "rescale_factor": 1 / 255,
    "image_mean": [0.5, 0.5, 0.5],
    "image_std": [0.5, 0.5, 0.5],
    "resample": 2,
}
TIPSV2_IMAGES = {
    "image_processor_type": "Tipsv2ImageProcessor",
    "do_resize": True,
    "do_rescale": True,
    "do_normalize": False,
    "rescale_factor": 1 / 255,
    "resample": 2,
}


def write_siglip(
    folder: Path,
    changes: Mapping[str, Any] | None = None,
    *,
    seed: int = 0,
    tokenizer: str = "Siglip2Tokenizer",
    images: Mapping[str, Any] | None = None,
) -> Path:
    """A SigLIP with the tokens of SigLIP 2: the config `SIGLIP` with changes."""
    from transformers import SiglipConfig, SiglipModel

    quieten_transformers()
    vocabulary = _vocabulary()
    config = merged(SIGLIP, {"text_config": {"vocab_size": len(vocabulary) + 3}})
    model = SiglipModel(SiglipConfig(**merged(config, changes or {}))).eval()
    redraw(model, seed)
    model.save_pretrained(folder)
    _tokenizer(tokenizer, vocabulary).save_pretrained(folder)
    side = model.config.vision_config.image_size
    size = {"size": {"height": side, "width": side}}
    write_json(folder / "preprocessor_config.json", {**SIGLIP_IMAGES, **size, **(images or {})})
    return folder


def write_tipsv2(
    folder: Path,
    changes: Mapping[str, Any] | None = None,
    *,
    seed: int = 0,
    images: Mapping[str, Any] | None = None,
) -> Path:
    """A TIPSv2: the config `TIPSV2` with changes."""
    from transformers import Tipsv2Config, Tipsv2Model, Tipsv2Tokenizer

    quieten_transformers()
    vocabulary = _vocabulary()
    config = merged(TIPSV2, {"text_config": {"vocab_size": len(vocabulary)}})
    model = Tipsv2Model(Tipsv2Config(**merged(config, changes or {}))).eval()
    redraw(model, seed)
    model.save_pretrained(folder)
    words = Tipsv2Tokenizer(vocab=vocabulary, merges=MERGES, eos_token="<eos>", bos_token="<bos>")
    words.save_pretrained(folder)
    side = model.config.vision_config.image_size
    size = {"size": {"height": side, "width": side}}
    write_json(folder / "preprocessor_config.json", {**TIPSV2_IMAGES, **size, **(images or {})})
    return folder


def _vocabulary() -> dict[str, int]:
    special = ["<pad>", "<eos>", "<bos>", "<unk>", "<mask>"]
    tokens = [*special, *(f"<0x{octet:02X}>" for octet in range(256)), *LETTERS]
    tokens += [left + right for left, right in MERGES]
    return {token: index for index, token in enumerate(dict.fromkeys(tokens))}


def _tokenizer(name: str, vocabulary: dict[str, int]) -> Any:
    import transformers

    if name == "GemmaTokenizer":  # as the checkpoints on the hub name it
        return transformers.GemmaTokenizer(
            vocab=vocabulary, merges=MERGES, add_bos_token=False, add_eos_token=True, padding_side="right"
        )
    return getattr(transformers, name)(vocab=vocabulary, merges=MERGES)
