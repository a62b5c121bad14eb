"""What a "go" without words accepts, and where that ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anytraverse.assessment import Assessment, Reason
from anytraverse.regions import Box
from anytraverse.roi import worst_tile
from companion.calls.numbers import Numbers

_REACH = 1.3
"""How much further than its box a thing may be found on the next frame, as it comes nearer."""
_UNCERTAIN = 0.5
"""Uncertainty from which a pixel belongs to the thing, where tiles have no threshold."""
_SPREAD = 8
"""Steps in which the accepted box grows over the whole thing at the start."""


@dataclass
class Acceptance:
    """The accepted reasons, the accepted box in the image, and the uncertainty that was seen.

    box: where the unknown thing is, None where no unknown object was accepted. similarity: as seen, or None.
    travelled: metres driven at its start, None where position is not known.
    """

    reasons: frozenset[Reason]
    box: Box | None
    uncertainty: float
    similarity: float | None
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
        box = None
        if Reason.UNKNOWN_OBJECT in reasons and seen.roi is not None:
            box = seen.roi.worst_tile.box.grown(1.5)
        acceptance = cls(reasons, box, 0.0, seen.similarity, now, travelled)
        for _ in range(_SPREAD):
            acceptance.follow(seen, numbers)
        acceptance.witness(seen)
        return acceptance

    def witness(self, seen: Assessment) -> None:
        """What the operator has been shown widens what a go accepts."""
        if seen.roi is not None:
            self.uncertainty = max(self.uncertainty, seen.roi.uncertainty)
        if seen.similarity is not None:
            self.similarity = min(seen.similarity, 1.0 if self.similarity is None else self.similarity)

    def covers(self, seen: Assessment, numbers: Numbers) -> frozenset[Reason]:
        """Those of the frame's reasons that stay within what was accepted."""
        covered = seen.reasons & self.reasons
        if Reason.UNKNOWN_OBJECT in covered and not self._covers_object(seen, numbers):
            covered -= {Reason.UNKNOWN_OBJECT}
        if Reason.UNKNOWN_SCENE in covered and not self._covers_scene(seen, numbers):
            covered -= {Reason.UNKNOWN_SCENE}
        return covered

    def follow(self, seen: Assessment, numbers: Numbers) -> None:
        """Move the box after the thing: down the image and wider, never up."""
        if self.box is None or seen.maps is None:
            return
        uncertainty = seen.maps.uncertainty
        height, width = uncertainty.shape
        near = self.box.grown(_REACH)
        thing = near.mask(height, width) & (uncertainty > (numbers.judging.thresholds.tile or _UNCERTAIN))
        rows, columns = np.flatnonzero(thing.any(axis=1)), np.flatnonzero(thing.any(axis=0))
        if len(rows) == 0:
            return
        found = Box(
            columns[0] / width, rows[0] / height, (columns[-1] + 1) / width, (rows[-1] + 1) / height
        ).grown(1.15)
        top = max(found.top, min(self.box.top, found.bottom - 1e-3))
        self.box = Box(found.left, top, found.right, found.bottom)

    def ended(self, seen: Assessment, numbers: Numbers, now: float, travelled: float | None) -> bool:
        """Whether the thing is gone, or the time or distance is over. Counts frames: once a frame."""
        self.clear_frames = 0 if seen.reasons & self.reasons else self.clear_frames + 1
        too_far = (
            travelled is not None
            and self.travelled is not None
            and travelled - self.travelled >= numbers.accepted_distance
        )
        return self.clear_frames >= numbers.ok_frames or now - self.since >= numbers.accepted_for or too_far

    def _covers_object(self, seen: Assessment, numbers: Numbers) -> bool:
        if seen.roi is None or seen.maps is None or self.box is None:
            return False
        if not seen.roi.uncertainty <= self.uncertainty + numbers.accepted_rise:
            return False
        limit = numbers.judging.thresholds.tile
        if limit is None:
            return True
        height, width = seen.frame.image.shape[:2]
        outside = worst_tile(
            seen.maps.uncertainty,
            numbers.judging.region,
            width / height,
            numbers.judging.tile_share,
            outside=self.box,
        )
        return outside is None or outside.uncertainty <= limit

    def _covers_scene(self, seen: Assessment, numbers: Numbers) -> bool:
        if seen.similarity is None or self.similarity is None:
            return False
        return seen.similarity >= self.similarity - numbers.judging.thresholds.similarity_margin
