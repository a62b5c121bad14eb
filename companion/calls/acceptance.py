"""What a "go" without words accepts, and where that ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import NAMED_TILE, Assessment, Reason
from anytraverse.history import Embedding, cosine
from anytraverse.regions import Box
from anytraverse.roi import worst_tile
from companion.calls.numbers import Numbers

Mask = NDArray[np.bool_]

_MARGIN = 1.15
"""How much larger than what is found of the thing its box is."""
_UNCERTAIN = 0.5
"""Uncertainty from which a pixel belongs to the thing, where tiles have no threshold."""


@dataclass
class Acceptance:
    """The accepted reasons, and what of them was seen.

    box: where the unknown thing is in the image, None where none was seen.
    uncertainty: mean of the ROI. beside: worst tile outside the box.
    scene: embedding of the accepted place, None where it is not known.
    travelled: metres driven at the start, None where not known.
    """

    reasons: frozenset[Reason]
    box: Box | None
    uncertainty: float
    beside: float
    scene: Embedding | None
    since: float
    travelled: float | None
    clear_frames: int = 0

    @classmethod
    def of(
        cls,
        seen: Assessment,
        reasons: frozenset[Reason],
        numbers: Numbers,
        now: float,
        travelled: float | None,
    ) -> Acceptance:
        """Accept `reasons` as they are in `seen`."""
        box, uncertainty = None, 0.0
        if seen.roi is not None and seen.tile is not None:
            uncertainty = seen.roi.uncertainty
            if Reason.UNKNOWN_OBJECT in reasons | seen.reasons:
                box = seen.tile.box.grown(1.5)
        accepted = cls(reasons, box, uncertainty, 0.0, scene_of(seen), now, travelled)
        found = accepted._find(seen, numbers, max(seen.maps.signed.shape)) if seen.maps is not None else None
        if box is not None and found is not None:
            accepted.box = _union(box, found)
        accepted.beside = accepted._beside(seen, numbers, by_name=False)
        return accepted

    def watch(self, seen: Assessment, numbers: Numbers) -> None:
        """Follow the thing while the call is open, with the uncertainty as it comes nearer.

        What turns up beside it was not in the picture that the operator is asked about.
        """
        limit = numbers.judging.thresholds.tile
        if limit is None:
            limit = self.beside + numbers.accepted_rise
        if seen.roi is not None and self._beside(seen, numbers, by_name=False) <= limit:
            self.uncertainty = max(self.uncertainty, seen.roi.uncertainty)
            self.follow(seen, numbers)

    def covers(self, seen: Assessment, numbers: Numbers) -> frozenset[Reason]:
        """Those of the frame's reasons that stay within what was accepted.

        Whether a thing has a name may change from frame to frame: an accepted one is covered either way.
        """
        covered = seen.reasons & self.reasons
        if Reason.UNKNOWN_OBJECT in covered:
            by_name = Reason.UNKNOWN_OBJECT in _named_reasons(seen)
            if not self._covers_object(seen, numbers, by_name=by_name):
                covered -= {Reason.UNKNOWN_OBJECT}
        if Reason.UNKNOWN_SCENE in covered and not self._covers_scene(seen, numbers):
            covered -= {Reason.UNKNOWN_SCENE}
        if self._names_thing(seen) and self._covers_object(seen, numbers, by_name=True):
            covered |= {Reason.BLOCKED}
        return covered

    def follow(self, seen: Assessment, numbers: Numbers) -> None:
        """Move the box after the thing: down the image and wider, never up."""
        self.box = self._moved(seen, numbers)

    def ended(self, seen: Assessment, numbers: Numbers, now: float, travelled: float | None) -> bool:
        """Whether the thing is gone, or the time or distance is over. Counts frames: once a frame."""
        if seen.reasons & self.reasons or self._names_thing(seen):
            self.clear_frames = 0
        elif Reason.FAULT not in seen.reasons:
            self.clear_frames += 1
        too_far = (
            travelled is not None
            and self.travelled is not None
            and travelled - self.travelled >= numbers.accepted_distance
        )
        return self.clear_frames >= numbers.ok_frames or now - self.since >= numbers.accepted_for or too_far

    def _names_thing(self, seen: Assessment) -> bool:
        """Whether an unknown thing was accepted and the frame is blocked by a tile with a name alone."""
        return Reason.UNKNOWN_OBJECT in self.reasons and blocked_by_name(seen)

    def _moved(self, seen: Assessment, numbers: Numbers) -> Box | None:
        """The box around the thing as it is in this frame; as it was where nothing is found of it."""
        if self.box is None or seen.maps is None:
            return self.box
        found = self._find(seen, numbers, _tile_side(seen.maps.signed.shape[1], numbers))
        if found is None:
            return self.box
        top = max(found.top, min(self.box.top, found.bottom - 1e-3))
        return Box(found.left, top, found.right, found.bottom)

    def _find(self, seen: Assessment, numbers: Numbers, reach: int) -> Box | None:
        """The box around what is uncertain in the accepted box and, up to `reach` pixels, what touches it.

        What a tapped word explains of the thing belongs to it: else that were a tapped thing beside it.
        """
        if self.box is None or seen.maps is None:
            return None
        limit = numbers.judging.thresholds.tile or _UNCERTAIN
        strange = seen.maps.strangeness > limit
        sought = strange if _named_reasons(seen) else seen.maps.uncertainty > limit
        thing = _connected(sought & self.box.mask(*strange.shape), strange, reach)
        height, width = strange.shape
        rows, columns = np.flatnonzero(thing.any(axis=1)), np.flatnonzero(thing.any(axis=0))
        if len(rows) == 0:
            return None
        left, right = int(columns[0]) / width, int(columns[-1] + 1) / width
        return Box(left, int(rows[0]) / height, right, int(rows[-1] + 1) / height).grown(_MARGIN)

    def _beside(self, seen: Assessment, numbers: Numbers, *, by_name: bool) -> float:
        """Uncertainty of the worst tile of the ROI beside the thing; 0 when there is no room for one.

        by_name: what was tapped counts as if it had no name.
        """
        if seen.maps is None:
            return 1.0
        height, width = seen.frame.image.shape[:2]
        judging = numbers.judging
        tile = worst_tile(
            seen.maps.strangeness if by_name else seen.maps.uncertainty,
            judging.region,
            width / height,
            judging.tile_share,
            outside=self._moved(seen, numbers),
        )
        return tile.uncertainty if tile is not None else 0.0

    def _covers_object(self, seen: Assessment, numbers: Numbers, *, by_name: bool) -> bool:
        if seen.roi is None or self.box is None:
            return False
        if not seen.roi.uncertainty <= self.uncertainty + numbers.accepted_rise:
            return False
        limit = numbers.judging.thresholds.tile
        return limit is None or self._beside(seen, numbers, by_name=by_name) <= limit

    def _covers_scene(self, seen: Assessment, numbers: Numbers) -> bool:
        scene = scene_of(seen)
        if scene is None or self.scene is None:
            return False
        return cosine(self.scene, scene) >= numbers.judging.thresholds.scene


def _named_reasons(seen: Assessment) -> frozenset[Reason]:
    """What the tile that a tapped word explains makes the frame bad for."""
    return frozenset(one.reason for one in seen.bad if one.figure == NAMED_TILE)


def blocked_by_name(seen: Assessment) -> bool:
    """Whether the frame is blocked by a tile with a name, and by nothing else."""
    return [one.figure for one in seen.bad if one.reason is Reason.BLOCKED] == [NAMED_TILE]


def scene_of(seen: Assessment) -> Embedding | None:
    """What the place looks like, None where nothing could be seen."""
    return seen.observation.embedding if seen.observation is not None else None


def _tile_side(width: int, numbers: Numbers) -> int:
    """Pixels of a map `width` pixels wide: a thing comes nearer by less than a tile from frame to frame."""
    bounds = numbers.judging.region.bounds
    return max(1, round(numbers.judging.tile_share * (bounds.right - bounds.left) * width))


def _connected(seed: Mask, within: Mask, steps: int) -> Mask:
    """`seed` and the pixels of `within` that lead to it over at most `steps` of their sides."""
    for _ in range(steps):
        spread = seed.copy()
        spread[1:] |= seed[:-1]
        spread[:-1] |= seed[1:]
        spread[:, 1:] |= seed[:, :-1]
        spread[:, :-1] |= seed[:, 1:]
        spread &= within
        if np.array_equal(spread, seed):
            break
        seed = spread
    return seed


def _union(one: Box, other: Box) -> Box:
    return Box(
        min(one.left, other.left),
        min(one.top, other.top),
        max(one.right, other.right),
        max(one.bottom, other.bottom),
    )
