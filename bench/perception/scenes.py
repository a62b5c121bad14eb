"""Asks the engine whether frames match remembered scenes: foreign ones, and the same places seen again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.engine import AnyTraverse
from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.frame import Frame, Image
from anytraverse.history import Embedding, Place
from anytraverse.memory import Memory, first_memory
from anytraverse.perception import DefaultThresholds, Example, Perceiver, Prompt
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from bench.perception.figures import Figure, share, share_of_tries
from bench.perception.frames import Frames
from bench.perception.judged import ROVER, shipped

FEW, MANY = 40, 256
"""Remembered scenes."""
_NEAR = 3
"""Frames of numbers at most so far apart may stand for each other: they are consecutive frames."""
_APART = 10
"""Frames of numbers so far apart are not taken for neighbours."""
_INLIERS = 12
"""Matched corners that one homography explains, from which two frames show one place. 112 pairs of frames of
other places reached 7."""
_ALIKE = 50
"""Bits of 256 by which the codes of matched corners differ at most."""
_WIDTH = 320


class Replay:
    """A perceiver that has seen the frame already: it gives embeddings as they were, and no attention."""

    def __init__(self, perceiver: Perceiver) -> None:
        self._perceiver = perceiver
        self.model_id = perceiver.model_id
        self.vocabulary = perceiver.vocabulary
        self.embedding: Embedding = np.zeros(1, dtype=np.float32)

    @property
    def defaults(self) -> DefaultThresholds:
        """Those of the perceiver."""
        return self._perceiver.defaults

    def meaning(self, word: str) -> str:
        """Ask the perceiver."""
        return self._perceiver.meaning(word)

    def encode(self, image: Image) -> None:
        """Nothing is encoded."""

    def attend(self, features: None, prompts: Sequence[Prompt]) -> NDArray[np.float32]:  # noqa: ARG002
        """No word explains anything: the scene is judged by its embedding alone."""
        return np.zeros((len(prompts), 8, 8), dtype=np.float32)

    def embed(self, features: None) -> Embedding:  # noqa: ARG002
        """Return the embedding that was set."""
        return self.embedding

    def example(self, features: None, box: Box) -> Example:
        """Nothing is tapped here."""
        raise NotImplementedError


@dataclass(eq=False)
class EmbeddedFrame:
    """Holds a frame's number, which is -1 where it does not matter, and its embedding."""

    number: int
    embedding: Embedding


class Rover:
    """A rover that remembers scenes; asks the engine, with its threshold, which of them a frame matches."""

    def __init__(self, perceiver: Perceiver, remembered: Sequence[EmbeddedFrame]) -> None:
        self._replay = Replay(perceiver)
        words = Preferences.parse(ROVER)
        memory = first_memory(perceiver.model_id, words)
        for number, one in enumerate(remembered, 1):
            memory = memory.remembering(one.embedding, number, Place(), move=False)
        # opposite to all that was seen, so that every frame is of another scene than the reference
        opposite = -np.mean([one.embedding for one in remembered], axis=0).astype(np.float32)
        self._memory: Memory = replace(memory, reference=opposite)
        self._remembered = remembered
        self._engine = AnyTraverse(self._replay, shipped(perceiver), self._memory)

    def matched(self, embedding: Embedding) -> EmbeddedFrame | None:
        """Return the remembered scene that the engine takes for a frame's, or None."""
        self._engine.memory = self._memory
        self._replay.embedding = embedding
        match = self._engine.step(Frame(1, 0.0, np.full((8, 8, 3), 128, dtype=np.uint8)), 0.0).match
        return None if match is None else self._remembered[match.entry.call_id - 1]


def measure_scenes(perceiver: Perceiver, frames: Frames, seed: int) -> dict[str, Figure]:
    """Measure foreign matches and near recall at 40 scenes of one drive, and at 256 of many."""
    rng = np.random.default_rng([seed, 9])

    def seen(image: Image, number: int = -1) -> EmbeddedFrame:
        return EmbeddedFrame(number, np.asarray(perceiver.embed(perceiver.encode(image)), dtype=np.float32))

    foreign = [seen(frame.image) for one in frames.abroad for frame in one.frames]
    foreign += [seen(image) for image in frames.strange]
    drives = [[seen(frame.image, frame.number) for frame in one.frames] for one in frames.home]
    found: dict[str, list[bool]] = {}
    tried: list[list[bool]] = []
    for index, (one, drive) in enumerate(zip(frames.home, drives, strict=True)):
        chosen = rng.choice(len(drive), min(FEW, len(drive)), replace=False)
        rover = Rover(perceiver, [drive[i] for i in chosen])
        others = [one for place, other in enumerate(drives) if place != index for one in other]
        tried.append([_matches(rover, f) for f in foreign])
        _add(
            found, f"foreign match at {FEW}: the other held-out drives", [_matches(rover, f) for f in others]
        )
        again = [seen(revisited(one.frames[i].image, rng), one.frames[i].number) for i in chosen]
        _add(found, f"near recall at {FEW}: other light, moved", [_finds(rover, s) for s in again])
        found.setdefault(f"near recall at {FEW}: next frame, verified", []).extend(
            _verified(perceiver, one.frames, drive, rng)
        )
    rest = frames.trained.frames
    chosen = rng.choice(len(rest), min(MANY, len(rest)), replace=False)
    many = [seen(rest[i].image, rest[i].number) for i in chosen]
    rover = Rover(perceiver, many)
    _add(found, f"foreign match at {MANY}: frames abroad", [_matches(rover, f) for f in foreign])
    held_out = [one for drive in drives for one in drive]
    _add(found, f"foreign match at {MANY}: the held-out drives", [_matches(rover, f) for f in held_out])
    again = [
        seen(revisited(rest[i].image, rng), rest[i].number) for i in chosen[:: max(1, len(chosen) // 80)]
    ]
    _add(found, f"near recall at {MANY}: other light, moved", [_finds(rover, s) for s in again])
    return {
        f"foreign match at {FEW}: frames abroad": share_of_tries(list(zip(*tried, strict=True))),
        **{name: share(hits) for name, hits in found.items()},
    }


def revisited(image: Image, rng: np.random.Generator) -> Image:
    """Change a frame as it may look on another day: moved and turned a little, nearer, in another light."""
    rows, columns = image.shape[:2]
    scale = float(rng.uniform(1.0, 1.1))
    matrix = cv2.getRotationMatrix2D((columns / 2, rows / 2), float(rng.uniform(-2, 2)), scale)
    matrix[:, 2] = matrix[:, 2] + rng.uniform(-0.04, 0.04, 2) * np.array([columns, rows])
    moved = cv2.warpAffine(image, matrix, (columns, rows), borderMode=cv2.BORDER_REFLECT)
    warmth = rng.normal(0, 0.06)
    gains = np.exp(np.clip(rng.normal(0, 0.3), -0.7, 0.5) + np.array([warmth, 0, -warmth]))
    return np.asarray(np.clip(moved * gains, 0, 255), dtype=np.uint8)


def same_place(one: Image, other: Image) -> bool:
    """Return whether two frames show one place from nearly one spot, by matched corners and a homography."""
    found = [_corners(image) for image in (one, other)]
    (points, codes), (others, other_codes) = found
    if codes is None or other_codes is None:
        return False
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
    matches = [match for match in matcher.match(codes, other_codes) if match.distance < _ALIKE]
    if len(matches) < _INLIERS:
        return False
    left = np.array([points[m.queryIdx].pt for m in matches], dtype=np.float32)
    right = np.array([others[m.trainIdx].pt for m in matches], dtype=np.float32)
    _, inside = cv2.findHomography(left, right, cv2.RANSAC, 4.0)
    return inside is not None and int(inside.sum()) >= _INLIERS


def _corners(image: Image) -> tuple[Sequence[cv2.KeyPoint], NDArray[np.uint8] | None]:
    size = _WIDTH, round(_WIDTH * image.shape[0] / image.shape[1])
    small = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    points, codes = cv2.ORB.create(800).detectAndCompute(small, np.ones(small.shape[:2], dtype=np.uint8))
    return points, None if codes is None else np.asarray(codes, dtype=np.uint8)


def _verified(
    perceiver: Perceiver,
    frames: Sequence[LabelledFrame],
    drive: Sequence[EmbeddedFrame],
    rng: np.random.Generator,
) -> list[bool]:
    """Match the later frame of each pair of one place, where the earlier one and others are remembered."""
    hits = []
    for index, (one, other) in enumerate(pairwise(frames)):
        if other.number - one.number > _NEAR or not same_place(one.image, other.image):
            continue
        far = [seen for seen in drive if abs(seen.number - one.number) > _APART]
        chosen = rng.choice(len(far), min(FEW - 1, len(far)), replace=False)
        rover = Rover(perceiver, [drive[index], *(far[i] for i in chosen)])
        hits.append(_finds(rover, drive[index + 1]))
    return hits


def _matches(rover: Rover, one: EmbeddedFrame) -> bool:
    return rover.matched(one.embedding) is not None


def _finds(rover: Rover, one: EmbeddedFrame) -> bool:
    """Return whether a frame matches its own place: a wrong place is as bad as none."""
    match = rover.matched(one.embedding)
    return match is not None and abs(match.number - one.number) <= _NEAR


def _add(found: dict[str, list[bool]], name: str, hits: Sequence[bool]) -> None:
    found.setdefault(name, []).extend(hits)
