"""What a frame was found to be: maps, figures, and every reason why it is not OK."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Frame
from anytraverse.history import Embedding, Entry, Match
from anytraverse.perception import Features, Prompt
from anytraverse.preferences import Preferences
from anytraverse.roi import KNOWN, RoiFigures, Tile

Map = NDArray[np.float32]

WORST_TILE = "worst_tile"
"""The figure that calls for what has no word."""
NAMED_TILE = "named_tile"
"""The figure that holds the vehicle before a thing that was named as not drivable."""
NAMED_MEAN = "roi_strangeness"
"""The same of all things of the ROI together."""
CORRIDOR = "corridor"
"""The figure that says whether the vehicle fits through."""


class Reason(str, Enum):
    """Why a frame is not OK. The first two are calls for words."""

    UNKNOWN_SCENE = "unknown_scene"
    UNKNOWN_OBJECT = "unknown_object"
    BLOCKED = "blocked"
    FAULT = "fault"


@dataclass(frozen=True)
class Finding:
    """One figure against its threshold.

    bad: on the wrong side of the threshold. clear: on the good side by the margin; between both, neither.
    value and threshold are NaN where a figure has none.
    """

    reason: Reason
    figure: str
    bad: bool
    clear: bool
    value: float = math.nan
    threshold: float = math.nan

    @classmethod
    def above(cls, reason: Reason, figure: str, value: float, threshold: float, margin: float) -> Finding:
        """Bad above the threshold; NaN is bad."""
        return cls(reason, figure, not value <= threshold, value <= threshold - margin, value, threshold)

    @classmethod
    def below(cls, reason: Reason, figure: str, value: float, threshold: float, margin: float) -> Finding:
        """Bad below the threshold; NaN is bad."""
        return cls(reason, figure, not value >= threshold, value >= threshold + margin, value, threshold)

    @classmethod
    def fault(cls, figure: str) -> Finding:
        """Something is broken, and `figure` says what."""
        return cls(Reason.FAULT, figure, bad=True, clear=False)


@dataclass(eq=False)
class Observation:
    """A frame after its one expensive pass, so that it can be judged again without another.

    `attended` keeps the last attention maps by the prompts that they answer. scene_at: when the earlier
    frame was taken that the embedding was made from; None: it is the frame's own.
    """

    frame: Frame
    features: Features
    embedding: Embedding
    attended: dict[tuple[Prompt, ...], Map] = field(default_factory=dict)
    scene_at: float | None = None

    @property
    def scene_age(self) -> float:
        """Seconds by which the embedding is older than the frame; 0 when it is the frame's own."""
        return 0.0 if self.scene_at is None else self.frame.captured_at - self.scene_at


@dataclass(frozen=True, eq=False)
class Maps:
    """Maps at the model's own resolution, float32 where nothing else is said.

    attention: (n, h, w) in [0, 1], one for each word in `Assessment.words`, in order.
    signed: (h, w) in [-1, 1], the pooled weights. uncertainty: (h, w) in [0, 1].
    strangeness: (h, w) in [0, 1], the uncertainty where only the words of positive weight are asked for;
    nowhere below `uncertainty`.
    drivable: (h, w) bool, pixels that a word of positive weight explains by itself, that no other word
    explains, and where the signed map is above 0. named: (n,) bool, the words of no positive weight.
    """

    attention: Map
    signed: Map
    uncertainty: Map
    strangeness: Map
    drivable: NDArray[np.bool_]
    named: NDArray[np.bool_]

    @property
    def traversability(self) -> Map:
        """The signed map clipped to [0, 1], (h, w)."""
        clipped: Map = np.clip(self.signed, 0.0, 1.0)
        return clipped

    @property
    def known(self) -> NDArray[np.bool_]:
        """Pixels that some word explains, (h, w)."""
        return self.uncertainty <= 1.0 - KNOWN

    @property
    def not_drivable(self) -> NDArray[np.bool_]:
        """Known pixels that are not drivable, (h, w)."""
        return self.known & ~self.drivable


@dataclass(frozen=True, eq=False)
class Assessment:
    """One judged frame. `maps`, `roi` and `observation` are None where a fault left nothing to judge.

    age: seconds from capture to judging. similarity: cosine to the reference, None without one.
    scene_age: seconds by which what was compared with the reference is older than the frame.
    match: the remembered scene that fits a changed scene, adopted or waiting for more votes.
    adopted: the remembered scene whose words came into force with this frame.
    dropped: words that went out of use with that: contradicted by it, or one too many.
    """

    frame: Frame
    words: Preferences
    findings: tuple[Finding, ...]
    age: float
    maps: Maps | None = None
    roi: RoiFigures | None = None
    similarity: float | None = None
    scene_age: float = 0.0
    match: Match | None = None
    adopted: Entry | None = None
    dropped: tuple[str, ...] = ()
    observation: Observation | None = field(default=None, repr=False)

    @property
    def bad(self) -> tuple[Finding, ...]:
        """The findings that are."""
        return tuple(finding for finding in self.findings if finding.bad)

    @property
    def reasons(self) -> frozenset[Reason]:
        """All reasons, not the first."""
        return frozenset(finding.reason for finding in self.bad)

    @property
    def ok(self) -> bool:
        """Judged, and without a reason."""
        return bool(self.findings) and not self.reasons

    @property
    def tile(self) -> Tile | None:
        """Where to look: the first that is bad of the worst tile, a thing with a name and the corridor's gap.

        The worst tile where none is; None without an ROI.
        """
        if self.roi is None:
            return None
        bad = {finding.figure for finding in self.bad}
        named = self.roi.named_tile
        if WORST_TILE not in bad and NAMED_TILE in bad and named is not None:
            return named.tile
        if not bad & {WORST_TILE, NAMED_TILE} and CORRIDOR in bad and self.roi.corridor.gap is not None:
            return self.roi.corridor.gap
        return self.roi.worst_tile

    def is_clear(self, reason: Reason) -> bool:
        """Whether the frame was judged and every figure of `reason` is on the good side by its margin."""
        if not self.findings:
            return False
        if reason is not Reason.FAULT and Reason.FAULT in self.reasons:
            return False
        return all(finding.clear for finding in self.findings if finding.reason is reason)

    def finding(self, reason: Reason) -> Finding | None:
        """The first bad finding of `reason`."""
        return next((one for one in self.bad if one.reason is reason), None)
