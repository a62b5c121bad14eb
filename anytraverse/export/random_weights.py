"""Makes models of random weights, to time a board before a download, and for tests.

Its maps mean nothing. Their values spread around one half, so that masks are neither empty nor full.
"""

from __future__ import annotations

import numpy as np

from anytraverse.export.architecture import Architecture, Decoder, DenseArchitecture, Text, Tower, Vision
from anytraverse.export.dense_making import DenseCheckpoint
from anytraverse.export.making import ClipSegCheckpoint, SceneCheckpoint
from anytraverse.perception.resizing import Fit
from anytraverse.perception.tokenizer import CLIP_WORDS, SPACE, load_tokenizers

_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)

RD64 = Architecture(
    Vision(Tower(12, 768, 12, 3072), 16, _MEAN, _STD),
    Text(Tower(12, 512, 8, 2048), 77, 49406, 49407),
    Decoder(Tower(3, 64, 4, 2048, act="relu"), (3, 6, 9), 0, transposed=True),
    joint=512,
)
"""CLIPSeg rd64-refined, as it was published."""

TINY = Architecture(
    Vision(Tower(4, 48, 3, 96), 16, _MEAN, _STD),
    Text(Tower(3, 32, 2, 64), 77, 512, 513),
    Decoder(Tower(2, 16, 2, 32, act="relu"), (0, 2), 0, transposed=True),
    joint=24,
)
"""Small enough for a test."""

B32 = Vision(Tower(12, 768, 12, 3072), 32, _MEAN, _STD)
"""CLIP ViT-B/32's image encoder."""


def _siglip(layers: int, width: int, heads: int, inner: int, patch: int) -> DenseArchitecture:
    tower = Tower(layers, width, heads, inner, "gelu_pytorch_tanh", 1e-6)
    return DenseArchitecture("siglip", Vision(tower, patch, (0.5,) * 3, (0.5,) * 3), 0, tower, 64, width)


def _tipsv2(layers: int, width: int, heads: int, inner: int, patch: int) -> DenseArchitecture:
    vision = Vision(Tower(layers, width, heads, inner, "gelu", 1e-6), patch, mean=(0.0,) * 3, std=(1.0,) * 3)
    return DenseArchitecture("tipsv2", vision, 2, Tower(layers, width, heads, inner, "relu"), 64, width)


DENSE = {"siglip": _siglip(12, 768, 12, 3072, 16), "tipsv2": _tipsv2(12, 768, 12, 3072, 14)}
"""SigLIP2-B/16 and TIPSv2-B/14, as they were published."""
DENSE_SIZES = {"siglip": 256, "tipsv2": 448}
TINY_DENSE = {"siglip": _siglip(2, 32, 2, 64, 8), "tipsv2": _tipsv2(2, 32, 2, 64, 8)}
"""Small enough for a test."""

_GRID = 14  # side of the published position tables: 224 pixels in patches of 16
_SHARPNESS = 3.0  # approximate standard deviation of the logits


def random_clipseg(arch: Architecture = RD64, seed: int = 0) -> ClipSegCheckpoint:
    """Make a checkpoint of random weights, the same for the same seed."""
    draw = _Draw(seed)
    vision, text, decoder, joint = arch.vision, arch.text, arch.decoder, arch.joint
    weights = _image_encoder(draw, vision, "clip.vision_model", _GRID)
    weights["clip.visual_projection.weight"] = draw.matrix(joint, vision.tower.width)
    weights |= draw.tower(text.tower, "clip.text_model.encoder.layers")
    weights |= draw.norm("clip.text_model.final_layer_norm", text.tower.width)
    table = "clip.text_model.embeddings"
    weights[f"{table}.token_embedding.weight"] = draw.normal(text.end + 1, text.tower.width)
    weights[f"{table}.position_embedding.weight"] = draw.normal(text.context, text.tower.width)
    weights["clip.text_projection.weight"] = draw.matrix(joint, text.tower.width)
    weights |= draw.tower(decoder.tower, "decoder.layers")
    for name, inputs in (("film_mul", joint), ("film_add", joint)):
        weights |= draw.linear(f"decoder.{name}", decoder.tower.width, inputs)
    for step in range(len(decoder.extract)):
        weights |= draw.linear(f"decoder.reduces.{step}", decoder.tower.width, vision.tower.width)
    weights |= _mask(draw, arch)
    return ClipSegCheckpoint(
        arch, weights, "bilinear", _bytes(text), {"weights": f"random, seed {seed}", "licence": "none needed"}
    )


def random_scene(vision: Vision = B32, joint: int = 512, seed: int = 0) -> SceneCheckpoint:
    """Make a scene encoder of random weights."""
    draw = _Draw(seed)
    side = 224 // 32
    weights = _image_encoder(draw, vision, "vision_model", side)
    weights["visual_projection.weight"] = draw.matrix(joint, vision.tower.width)
    pixels = side * vision.patch
    source = {"weights": f"random, seed {seed}", "licence": "none needed"}
    return SceneCheckpoint(vision, weights, Fit(pixels, pixels, "bicubic", crop=True), source)


def random_dense(
    family: str, arch: DenseArchitecture | None = None, size: int | None = None, seed: int = 0
) -> DenseCheckpoint:
    """Make a dense model of random weights; its tokens are bytes. family: a key of `DENSE`."""
    draw, arch = _Draw(seed), arch or DENSE[family]
    side = size or DENSE_SIZES[family]
    vision, text, patch = arch.vision, arch.text, arch.vision.patch
    width = vision.tower.width
    weights = draw.tower(vision.tower, "vision.encoder.layers") | draw.norm("vision.post_layernorm", width)
    weights["vision.patch.weight"] = draw.matrix(width, 3 * patch**2).reshape(width, 3, patch, patch)
    weights["vision.patch.bias"] = draw.normal(width, spread=0.1)
    weights["vision.positions"] = draw.normal((side // patch) ** 2, width)
    weights["vision.before"] = draw.normal(arch.before, width)
    weights |= draw.tower(text, "text.encoder.layers") | draw.norm("text.final_layer_norm", text.width)
    weights["text.embeddings.position_embedding.weight"] = draw.normal(arch.context, text.width)
    if family == "siglip":
        weights |= draw.linear("text.head", arch.joint, text.width) | draw.norm("head.layernorm", width)
        weights["head.probe"] = draw.normal(1, width)
        for part in ("q_proj", "k_proj", "v_proj", "out_proj"):
            weights |= draw.linear(f"head.attention.{part}", width, width)
        weights |= draw.linear("head.mlp.fc1", vision.tower.inner, width)
        weights |= draw.linear("head.mlp.fc2", width, vision.tower.inner)
    source = {"weights": f"random, seed {seed}", "licence": "none needed"}
    tokenizer, tokens = _byte_fallback(arch.context, siglip=family == "siglip")
    table = draw.normal(tokens, text.width)
    return DenseCheckpoint(arch, weights, table, tokenizer, side, "bilinear", source)


class _Draw:
    """Draws random weights that keep the scale of the activations."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def normal(self, *shape: int, spread: float = 1.0) -> np.ndarray:
        return np.float32(spread) * self._random.standard_normal(shape, dtype=np.float32)

    def matrix(self, outputs: int, inputs: int) -> np.ndarray:
        return self.normal(outputs, inputs, spread=inputs**-0.5)

    def linear(self, name: str, outputs: int, inputs: int) -> dict[str, np.ndarray]:
        return {
            f"{name}.weight": self.matrix(outputs, inputs),
            f"{name}.bias": self.normal(outputs, spread=0.1),
        }

    def norm(self, name: str, width: int) -> dict[str, np.ndarray]:
        scale, shift = self.normal(width, spread=0.1), self.normal(width, spread=0.1)
        return {f"{name}.weight": 1 + scale, f"{name}.bias": shift}

    def tower(self, tower: Tower, name: str) -> dict[str, np.ndarray]:
        weights: dict[str, np.ndarray] = {}
        for index in range(tower.layers):
            layer = f"{name}.{index}"
            for part in ("q_proj", "k_proj", "v_proj", "out_proj"):
                weights |= self.linear(f"{layer}.self_attn.{part}", tower.width, tower.width)
            weights |= self.linear(f"{layer}.mlp.fc1", tower.inner, tower.width)
            weights |= self.linear(f"{layer}.mlp.fc2", tower.width, tower.inner)
            weights |= self.norm(f"{layer}.layer_norm1", tower.width)
            weights |= self.norm(f"{layer}.layer_norm2", tower.width)
        return weights


def _image_encoder(draw: _Draw, vision: Vision, name: str, side: int) -> dict[str, np.ndarray]:
    width, patch = vision.tower.width, vision.patch
    weights = draw.tower(vision.tower, f"{name}.encoder.layers")
    kernel = draw.matrix(width, 3 * patch * patch).reshape(width, 3, patch, patch)
    weights[f"{name}.embeddings.patch_embedding.weight"] = kernel
    weights[f"{name}.embeddings.class_embedding"] = draw.normal(width)
    weights[f"{name}.embeddings.position_embedding.weight"] = draw.normal(side * side + 1, width)
    return weights | draw.norm(f"{name}.pre_layrnorm", width) | draw.norm(f"{name}.post_layernorm", width)


def _mask(draw: _Draw, arch: Architecture) -> dict[str, np.ndarray]:
    name, width = "decoder.transposed_convolution", arch.decoder.tower.width
    if not arch.decoder.transposed:
        patch = arch.vision.patch
        kernel = draw.normal(width, 1, patch, patch, spread=_SHARPNESS * width**-0.5)
        return {f"{name}.weight": kernel, f"{name}.bias": np.zeros(1, dtype=np.float32)}
    side, half = arch.vision.patch // 4, width // 2
    return {
        f"{name}.0.weight": draw.matrix(width, 9 * width).reshape(width, width, 3, 3),
        f"{name}.0.bias": draw.normal(width, spread=0.1),
        f"{name}.2.weight": draw.normal(width, half, side, side, spread=(2 / width) ** 0.5),
        f"{name}.2.bias": draw.normal(half, spread=0.1),
        f"{name}.4.weight": draw.normal(half, 1, side, side, spread=_SHARPNESS * (2 / half) ** 0.5),
        f"{name}.4.bias": np.zeros(1, dtype=np.float32),
    }


def _bytes(text: Text) -> str:
    """Make a tokenizer without merges: every byte is a token, and another one at the end of a word."""
    library = load_tokenizers()
    split, start, end = library.pre_tokenizers, ("<|startoftext|>", text.start), ("<|endoftext|>", text.end)
    symbols = sorted(split.ByteLevel.alphabet())
    ids = {symbol: index for index, symbol in enumerate((*symbols, *(f"{one}</w>" for one in symbols)))}
    ids |= {f"unused {index}": index for index in range(len(ids), text.start)} | dict((start, end))
    model = library.models.BPE(vocab=ids, merges=[], unk_token=end[0], end_of_word_suffix="</w>")
    made = library.Tokenizer(model)
    made.normalizer = library.normalizers.Sequence(
        [library.normalizers.NFC(), library.normalizers.Lowercase()]
    )
    pieces = split.Split(library.Regex(CLIP_WORDS), "removed", invert=True)
    made.pre_tokenizer = split.Sequence([pieces, split.ByteLevel(add_prefix_space=False)])
    made.post_processor = library.processors.RobertaProcessing(
        end, start, trim_offsets=False, add_prefix_space=False
    )
    made.add_special_tokens([start[0], end[0]])
    made.enable_truncation(text.context)
    return str(made.to_str())


def _byte_fallback(context: int, *, siglip: bool) -> tuple[str, int]:
    """Make a tokenizer of SentencePiece's kind without merges, and say how many tokens it has."""
    library = load_tokenizers()
    ids = {token: index for index, token in enumerate(("<pad>", "<eos>", "<bos>", "<unk>", SPACE))}
    ids |= {f"<0x{octet:02X}>": len(ids) + octet for octet in range(256)}
    made = library.Tokenizer(library.models.BPE(vocab=ids, merges=[], byte_fallback=True))
    lower, split = library.normalizers.Lowercase(), library.pre_tokenizers
    template = library.processors.TemplateProcessing
    if siglip:
        made.normalizer = library.normalizers.Sequence([lower, library.normalizers.Replace(" ", SPACE)])
        made.pre_tokenizer = split.Split(" ", "merged_with_previous")
        made.post_processor = template(single="$A <eos>", special_tokens=[("<eos>", ids["<eos>"])])
        made.enable_padding(length=context, pad_id=ids["<pad>"], pad_token="<pad>")
    else:
        made.normalizer = lower
        made.pre_tokenizer = split.Sequence([split.WhitespaceSplit(), split.Metaspace()])
        made.post_processor = template(single="$A")
    made.enable_truncation(context)
    return str(made.to_str()), len(ids)
