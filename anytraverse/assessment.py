"""Holds the result of judging a frame: maps, figures, and every reason why it is not OK."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Frame
from anytraverse.history import Embedding, Entry, Likeness, Match
from anytraverse.light import Light
from anytraverse.perception import Features, Prompt
from anytraverse.preferences import Preferences
from anytraverse.roi import RoiFigures, Tile

Map = NDArray[np.float32]

WORST_TILE = "worst_tile"
"""Figure: the worst tile's uncertainty. Above its threshold, a thing without a word calls."""
ROI_MEAN = "roi_uncertainty"
"""Figure: the mean uncertainty of the ROI."""
NAMED_TILE = "named_tile"
"""Figure: the named tile's strangeness. Above its threshold, a thing named as not drivable holds."""
NAMED_MEAN = "roi_strangeness"
"""Figure: the mean strangeness of the ROI, for all named things in it together."""
CORRIDOR = "corridor"
"""Figure: whether the vehicle fits through."""


class Reason(str, Enum):
    """Names why a frame is not OK. The first two call the operator for words."""

    UNKNOWN_SCENE = "unknown_scene"
    UNKNOWN_OBJECT = "unknown_object"
    BLOCKED = "blocked"
    FAULT = "fault"


@dataclass(frozen=True)
class Finding:
    """Holds the result of comparing one figure with its threshold.

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
        """Make a finding that is bad above the threshold; NaN is bad."""
        # `not value <= ...` and not `value > ...`: every comparison with NaN is False
        return cls(reason, figure, not value <= threshold, value <= threshold - margin, value, threshold)

    @classmethod
    def below(cls, reason: Reason, figure: str, value: float, threshold: float, margin: float) -> Finding:
        """Make a finding that is bad below the threshold; NaN is bad."""
        return cls(reason, figure, not value >= threshold, value >= threshold + margin, value, threshold)

    @classmethod
    def fault(cls, figure: str) -> Finding:
        """Make a finding that something is broken; `figure` says what, in one line."""
        line = "".join(one if one.isprintable() else " " for one in figure)  # as of a library's error
        return cls(Reason.FAULT, line, bad=True, clear=False)


@dataclass(eq=False)
class Observation:
    """Holds an encoded frame, so that it can be judged again without another encoding.

    attended: prompts -> the attention maps made for them last. scene_at: capture time of the earlier frame
    whose embedding is used; None: the embedding is this frame's own.
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
    """Holds maps at the model's own resolution, float32 unless stated otherwise.

    attention: (n, h, w) in [0, 1], one for each word in `Assessment.words`, in order.
    signed: (h, w) in [-1, 1], the pooled weights. uncertainty: (h, w) in [0, 1].
    strangeness: (h, w) in [0, 1], the uncertainty as it is when only the words of positive weight are asked
    for; nowhere below `uncertainty`.
    drivable: (h, w) bool, pixels that a word of positive weight explains by itself, that no other word
    explains, and where the signed map is above 0. named: (n,) bool, True for words of weight 0 or below.
    known: (h, w) bool, pixels that some word explains, or, where words compete, these words together.
    """

    attention: Map
    signed: Map
    uncertainty: Map
    strangeness: Map
    drivable: NDArray[np.bool_]
    named: NDArray[np.bool_]
    known: NDArray[np.bool_]

    @property
    def traversability(self) -> Map:
        """The signed map clipped to [0, 1], (h, w)."""
        clipped: Map = np.clip(self.signed, 0.0, 1.0)
        return clipped

    @property
    def not_drivable(self) -> NDArray[np.bool_]:
        """Known pixels that are not drivable, (h, w)."""
        return self.known & ~self.drivable


@dataclass(frozen=True, eq=False)
class Assessment:
    """Holds one judged frame. `maps`, `roi` and `observation` are None where a fault prevented judging.

    age: seconds from capture to judging. similarity: cosine to the reference, None without one.
    scene_age: seconds by which the embedding compared with the reference is older than the frame.
    match: the remembered scene that fits a changed scene, adopted or waiting for more votes.
    undecided: whether a changed scene may still prove to be a remembered one: its match waits for more votes,
    or it misses one by at most the margin of the similarity.
    likeness: of a changed scene that matches none, the scene that it is most nearly; None where not known.
    adopted: the remembered scene whose words came into force with this frame.
    dropped: words that this put out of use: contradicted by the adopted words, or beyond the limit of 16.
    asked: the tile that an operator is asked about, where it is another one than the worst.
    light: the picture's, None where it could not be judged; see `light_name`.
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
    undecided: bool = False
    likeness: Likeness | None = None
    adopted: Entry | None = None
    dropped: tuple[str, ...] = ()
    light: Light | None = None
    observation: Observation | None = field(default=None, repr=False)
    asked: Tile | None = None

    @property
    def bad(self) -> tuple[Finding, ...]:
        """The findings that are bad."""
        return tuple(finding for finding in self.findings if finding.bad)

    @property
    def reasons(self) -> frozenset[Reason]:
        """The reasons of all bad findings."""
        return frozenset([finding.reason for finding in self.findings if finding.bad])

    @property
    def ok(self) -> bool:
        """Whether the frame was judged, and no finding is bad."""
        return bool(self.findings) and not self.reasons

    @property
    def tile(self) -> Tile | None:
        """Where to look: what is asked about, or the first bad one of worst and named tile and gap.

        The worst tile where none of them is bad; None without ROI figures. To a person `shown` is shown.
        """
        if self.roi is None or self.asked is not None:
            return self.asked
        bad = {finding.figure for finding in self.bad}
        named = self.roi.named_tile
        if WORST_TILE not in bad and NAMED_TILE in bad and named is not None:
            return named.tile
        if not bad & {WORST_TILE, NAMED_TILE} and CORRIDOR in bad and self.roi.corridor.gap is not None:
            return self.roi.corridor.gap
        return self.roi.worst_tile

    def is_clear(self, reason: Reason) -> bool:
        """Return whether the frame was judged and every figure of `reason` is good by its margin.

        A fault keeps every other reason from being clear: a frame with a fault shows nothing.
        """
        for finding in self.findings:
            of_it, fault = finding.reason is reason, finding.reason is Reason.FAULT
            if (of_it and not finding.clear) or (fault and not of_it and finding.bad):
                return False
        return bool(self.findings)

    def finding(self, reason: Reason) -> Finding | None:
        """Return the first bad finding of `reason`, or None."""
        return next((one for one in self.bad if one.reason is reason), None)
