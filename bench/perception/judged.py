"""Judges frames with a perceiver's shipped thresholds, and keeps only what judging again needs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from anytraverse.assessment import Assessment, Observation
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import first_memory
from anytraverse.perception import Perceiver
from anytraverse.preferences import Preferences

ROVER = "grass: 1; dirt: 1; trail: 1; bush: -1; water: -1"
"""The rover's words."""
EVERY = (
    "trail: 1; dirt: 1; gravel: 1; grass: 1; bush: -1; tree: -1; sky: -1; water: -1; rock: -1; log: -1; "
    "obstacle: -1"
)
"""A word for all that is labelled."""


def shipped(perceiver: Perceiver) -> Settings:
    """Return the settings of a rover whose configuration changes nothing."""
    # not every perceiver has a size of tiles of its own
    share = getattr(perceiver.defaults, "tile_share", Settings.tile_share)
    return Settings(thresholds=Thresholds.of(perceiver.defaults), tile_share=share)


def changed(settings: Settings, tile_share: float | None = None, tile: float | None = None) -> Settings:
    """Return the settings with another size of tiles, and another threshold for them, where given."""
    limits = settings.thresholds if tile is None else replace(settings.thresholds, tile=tile)
    share = settings.tile_share if tile_share is None else tile_share
    return replace(settings, thresholds=limits, tile_share=share)


@dataclass
class Judge:
    """Judges pictures one at a time: a new one costs an encoding, an `Observation` that it made does not."""

    engine: AnyTraverse

    @classmethod
    def of(cls, perceiver: Perceiver, words: str = ROVER) -> Judge:
        """Make a judge with the shipped thresholds, and without a reference scene."""
        asked = Preferences.parse(words)
        return cls(AnyTraverse(perceiver, shipped(perceiver), first_memory(perceiver.model_id, asked)))

    @property
    def settings(self) -> Settings:
        """The settings in force."""
        return self.engine.settings

    def with_settings(self, settings: Settings) -> Judge:
        """Return a judge with the same words and other settings."""
        return Judge(AnyTraverse(self.engine.perceiver, settings, self.engine.memory))

    def see(self, image: Image) -> Assessment:
        """Encode a picture and judge it; its `observation` can be judged again, with these words only."""
        judged = self.engine.judge(self.engine.observe(Frame(1, 0.0, image)), 0.0)
        assert judged.observation is not None
        _lighten(judged.observation)
        return judged

    def see_briefly(self, image: Image, *, keep: bool) -> Assessment:
        """Encode a picture and judge it, without its maps; keep: so that it can be judged again."""
        judged = self.see(image)
        return replace(judged, maps=None, roi=None, observation=judged.observation if keep else None)

    def again(self, seen: Observation) -> Assessment:
        """Judge what `see` saw, without another encoding."""
        return self.engine.judge(seen, 0.0)

    def see_all(self, images: Iterable[Image]) -> list[Assessment]:
        """Encode and judge pictures."""
        return [self.see(image) for image in images]


def _lighten(seen: Observation) -> None:
    """Drop the picture and the features: the attention maps that `judge` made are kept, and suffice.

    A picture of one value and the same size, which takes no memory, stands for the frame.
    """
    grey = np.broadcast_to(np.uint8(128), seen.frame.image.shape)
    seen.frame = replace(seen.frame, image=grey)
    seen.features = None
