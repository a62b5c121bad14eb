"""A dense bundle beside transformers' own model of the same checkpoint."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.bundle.records import CheckRuntime
from anytraverse.export import export_bundle
from anytraverse.export.dense_making import ABSENT, TEMPLATES
from anytraverse.frame import Image
from anytraverse.perception import Prompt
from anytraverse.perception.dense.details import GROUP, ScoreCalibration
from anytraverse.perception.dense.perceiver import Dense
from anytraverse.perception.tokenizer import Tokenizer
from tests.anytraverse.clipseg.pictures import picture

Array = NDArray[np.float32]
FEW_ABSENT = ABSENT[:GROUP]


class DenseParity:
    """`ours` runs the bundle, `theirs` is transformers'. Pictures are size x size."""

    def __init__(self, checkpoint: Path, bundle: Path, size: int, **options: Any) -> None:
        import transformers

        self.size = size
        export_bundle(str(checkpoint), bundle, size=size, absent=FEW_ABSENT, **options)
        self.ours = Dense(str(bundle), CheckRuntime(threads=1, precision="fp32"))
        self.tokenizer = Tokenizer.load(bundle / "tokenizer.json")
        self.theirs: Any = transformers.AutoModel.from_pretrained(checkpoint).eval()
        self._tokens: Any = transformers.AutoTokenizer.from_pretrained(checkpoint)
        self._siglip = self.theirs.config.model_type == "siglip"

    def frame(self, seed: int) -> Image:
        """A picture that needs no resize, so that both see the same pixels."""
        return picture(self.size, self.size, seed)

    def tokens(self, texts: Sequence[str]) -> Any:
        """What transformers' tokenizer makes of each text."""
        given = {"padding": "max_length" if self._siglip else True, "truncation": True, "max_length": 64}
        return self._tokens([text.lower() for text in texts], return_tensors="pt", **given)

    def seen(self, frame: Image) -> tuple[Array, Array]:
        """Their features, (patches, d), and scene, (d,), of length 1."""
        import torch

        level = np.array(0.5 if self._siglip else 0.0)
        pixels = torch.from_numpy((frame / 255 - level) / (level or 1.0)).permute(2, 0, 1)[None].float()
        more = {"interpolate_pos_encoding": True} if self._siglip else {}
        with torch.no_grad():
            made = self.theirs.vision_model(pixel_values=pixels, **more)
            if self._siglip:  # the head, given one patch at a time, gives the feature of that patch
                patches = self.theirs.vision_model.head(made.last_hidden_state[0][:, None])
            else:
                patches = made.last_hidden_state[
                    0, 1 + self.theirs.config.vision_config.num_register_tokens :
                ]
        return _unit(patches.numpy()), _unit(made.pooler_output[0].numpy())

    def embeddings(self, words: Sequence[str]) -> Array:
        """Their embeddings of words by all templates, (words, d)."""
        import torch

        made = []
        for word in words:
            given = self.tokens([template.replace("{}", word) for template in TEMPLATES])
            masks = {} if self._siglip else {"attention_mask": given.attention_mask}
            with torch.no_grad():
                texts = self.theirs.get_text_features(input_ids=given.input_ids, **masks).pooler_output
            made.append(_unit(_unit(texts.numpy()).mean(axis=0)))
        return np.stack(made)

    def maps(self, frame: Image, words: Sequence[str]) -> tuple[Array, Array]:
        """Our attention and theirs, (words, h, w), calibrated alike."""
        patches, _ = self.seen(frame)
        scores = (self.embeddings(words) - self.embeddings(FEW_ABSENT).mean(axis=0)) @ patches.T
        level = ScoreCalibration(float(np.median(scores)), float(scores.std()) / 2, 1, 0.05)
        self.ours.calibration = level
        theirs = 1 / (1 + np.exp(-(scores - level.threshold) / level.temperature))
        ours = self.ours.attend(self.ours.encode(frame), [Prompt(word) for word in words])
        return ours, theirs.reshape(ours.shape)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
