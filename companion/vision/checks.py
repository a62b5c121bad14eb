"""Checks what decoding a report of the vision process leaves open: ranges, shapes, and how values relate."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

import numpy as np

from anytraverse.answers import LARGEST_EXAMPLES, MAX_EXAMPLES, AnswerOutcome
from anytraverse.assessment import Assessment, Maps
from anytraverse.frame import is_intrinsics
from anytraverse.grid import CELL, FARTHEST, SIDE
from anytraverse.ground import RELIABLE
from anytraverse.history import MAX_REFUSED, Embedding, Entry
from anytraverse.judging import Settings
from anytraverse.memory import MOST_GIVEN, Examples
from anytraverse.preferences import MAX_WORDS
from anytraverse.roi import RoiFigures
from companion.guide.plan import Plan
from companion.guide.tree import TIGHTEST
from companion.vehicle.motion import LARGEST_LEAN
from companion.vision.evidence import contradiction
from companion.vision.freeze_detector import CELLS
from companion.vision.messages import (
    LARGEST_WHOLE,
    LONGEST_TEXT,
    ROUNDING,
    Alive,
    Done,
    FrameJudged,
    GroundMap,
    MemoryUpdate,
    Planned,
    Ready,
    Report,
    Scenes,
)

LARGEST_MAP = 4 << 20
"""Pixels of one map, at most."""
LONGEST_VECTOR = (1 << 14) + 2
"""Of the widest bundle: its channels, and what a tap remembers beside them."""
_AHEAD = 0.001
"""Seconds by which a time stamp of the vision process may lie in the future, because of rounding."""
_U32 = 0xFFFFFFFF
MOST_ARCS = 2
"""Of one plan."""
MOST_TUNINGS = 256
"""Settings by which the next frame may have been judged, at most."""


class BadReportError(Exception):
    """A report has an impossible value: the process that sent it can no longer be trusted."""


@dataclass
class Expected:
    """Holds what the next report is compared with.

    last_frame: id of the newest frame reported so far. settings: those by which frames may have been judged,
    by the number of their `Tune`, the oldest first.
    """

    last_frame: int
    settings: dict[int, Settings]

    def settings_of(self, tuning: int) -> Settings:
        """Return the settings of a `Tune`; earlier ones do not come any more. Raises BadReportError."""
        _need(tuning in self.settings, "by which settings it was judged")
        self.settings = {number: one for number, one in self.settings.items() if number >= tuning}
        return self.settings[tuning]


def check_report(message: Report, expected: Expected, now: float) -> Report:
    """Check a decoded report and return it. Raises BadReportError. now: monotonic seconds."""
    try:
        _check(message, expected, now)
    except BadReportError:
        raise
    except Exception as error:  # the values may be any of their types, and no failure of theirs is ours
        raise BadReportError(f"wrong: {error!r:.200}") from error
    return message


def _check(message: Report, expected: Expected, now: float) -> None:
    match message:
        case FrameJudged():
            _check_frame_judged(message, expected, now)
        case Done(_, outcome, error, update, tuning):
            _need((outcome is None) == bool(error), "an outcome or an error")
            if outcome is not None:
                _check_outcome(outcome, expected.settings_of(tuning), now)
            if update is not None:
                _check_update(update)
        case Ready():
            _check_update(message.update)
        case Alive(camera, delivered_at):
            counts = camera.read, camera.dropped, camera.refused, camera.connected
            _need(_texts(camera.reason, camera.timed_by) and _whole(*counts), "the state of a camera")
            _need(_whole(camera.width, camera.height), "the size of a camera's pictures")
            lens = camera.intrinsics
            _need(lens is None or is_intrinsics(lens), "the intrinsics of a camera")
            _need(delivered_at is None or _past(delivered_at, now), "when a frame came")
        case GroundMap(content):
            _need(content.at >= 0.0 and _past(content.at, now), "when ground was seen")
            _need(
                all(abs(one) <= FARTHEST for one in (*content.pose, *content.corner)), "where ground was seen"
            )
            sizes = {len(content.share), len(content.uncertainty)}
            _need(sizes == {SIDE * SIDE}, "the cells of a grid")
        case Planned(content):
            _check_plan(content, now)
        case Scenes(entries):
            _check_entries(entries)


def _check_plan(plan: Plan, now: float) -> None:
    _need(plan.at >= 0.0 and _past(plan.at, now), "when a way was planned")
    _need(all(abs(one) <= FARTHEST for one in plan.pose), "where a way begins")
    lengths = [length for _, length in plan.arcs]
    _need(_in(0.0, RELIABLE, plan.route_clear, plan.clear, *lengths), "how far a way leads")
    _need(_in(0.0, SIDE * CELL, plan.gap), "how narrow a way is")
    tightest = 1.0 / TIGHTEST
    _need(_in(-tightest, tightest, *(curvature for curvature, _ in plan.arcs)), "how a way turns")
    _need(len(lengths) <= MOST_ARCS and abs(sum(lengths) - plan.clear) <= ROUNDING, "the arcs of a way")


def _check_frame_judged(judged: FrameJudged, expected: Expected, now: float) -> None:
    seen = judged.assessment
    _check_assessment(seen, expected.settings_of(judged.tuning), now)
    _need(seen.similarity is not None or not seen.ok, "OK without a similarity")
    _need(seen.frame.id > expected.last_frame, f"frame {seen.frame.id} after {expected.last_frame}")
    _need(_past(judged.at, now) and judged.at >= seen.frame.captured_at, "when a frame was judged")
    still = judged.luma
    _need(still.shape == CELLS[::-1] and bool(np.isfinite(still).all()), "a picture's luma")
    if judged.update is not None:
        _check_update(judged.update)
    expected.last_frame = seen.frame.id


def _check_outcome(outcome: AnswerOutcome, settings: Settings, now: float) -> None:
    _need(_texts(*outcome.dropped, *outcome.undone), "words that an answer changed")
    _need(_whole(*outcome.forgotten), "what a refusal changed")
    for seen in (outcome.call, outcome.newest):
        if seen is not None:
            _check_assessment(seen, settings, now)


def _check_assessment(seen: Assessment, settings: Settings, now: float) -> None:
    _need(0 <= seen.frame.id <= _U32, "a frame's id")
    _need(_past(seen.frame.captured_at, now), "when a frame was taken")
    _need(_texts(*seen.dropped), "words")
    _need(_finite(seen.age, seen.scene_age), "a frame's age, or its scene's")
    _need(seen.similarity is None or _in(-1.0, 1.0, seen.similarity), "a similarity")
    if seen.likeness is not None:
        like = seen.likeness
        _need(_whole(like.call_id), "the scene that a frame is most nearly")
        _need(_in(-1.0, 1.0, like.similarity, like.needed), "how much a scene is alike")
    if seen.light is not None:
        _need(_in(0.0, 256.0, seen.light.mean, seen.light.darkest), "a picture's light")
    for finding in seen.findings:
        _need(_texts(finding.figure), "a finding")
        _need(not (finding.bad and finding.clear), "a finding that is bad and clear")
    if seen.maps is not None:
        _check_maps(seen.maps, len(seen.words))
    if seen.roi is not None:
        _check_roi(seen.roi)
    _need(seen.asked is None or _shares(seen.asked.uncertainty), "the tile that is asked about")
    _need(seen.frame.depth is None and seen.frame.intrinsics is None, "a depth, which is left out")
    lean = seen.frame.lean
    _need(lean is None or (_finite(*lean) and max(map(abs, lean)) <= LARGEST_LEAN), "how the vehicle leans")
    pose = seen.frame.pose
    _need(pose is None or all(abs(one) <= FARTHEST for one in pose), "the vehicle's pose")
    _need(seen.frame.reach is None or 0.0 < seen.frame.reach <= RELIABLE, "how far the ground is judged")
    if (observation := seen.observation) is not None:
        _need(observation.frame.id == seen.frame.id, "an observation of another frame")
        _need(observation.features is None and not observation.attended, "features, which are left out")
    scenes = seen.adopted, seen.match.entry if seen.match is not None else None
    _check_entries(scene for scene in scenes if scene is not None)
    wrong = contradiction(seen, settings)
    _need(not wrong, wrong)


def _check_maps(maps: Maps, words: int) -> None:
    shape = maps.signed.shape
    _need(len(shape) == 2 and 0 < maps.signed.size <= LARGEST_MAP, f"maps of shape {shape}")
    for name, lowest in (("signed", -1.0), ("uncertainty", 0.0), ("strangeness", 0.0)):
        one = getattr(maps, name)
        right = one.shape == shape and lowest <= float(one.min()) and float(one.max()) <= 1.0
        _need(right, f"values of the map {name}")  # where one is NaN, both are
    for name, right_shape in (("drivable", shape), ("known", shape), ("named", (words,))):
        _need(getattr(maps, name).shape == right_shape, f"the map {name}")


def _check_roi(roi: RoiFigures) -> None:
    way, named = roi.corridor, roi.named_tile
    _need(way.open <= way.passable and way.roomy <= way.open, "a corridor that is open and not passable")
    shares = [way.explained, roi.uncertainty, roi.strangeness, roi.traversability, roi.known_share]
    if named is not None:
        _need(_whole(named.word), "a named tile")
        shares += [named.explained, named.left, named.tile.uncertainty]
    shares += [tile.uncertainty for tile in (roi.worst_tile, way.gap) if tile is not None]
    shares += [] if roi.drivable_share is None else [roi.drivable_share]
    _need(_shares(*shares), "figures of the ROI")


def _check_update(update: MemoryUpdate) -> None:
    memory, match = update.memory, update.memory.adoption
    _need(_whole(memory.clock, *memory.settled.values()), "stamps of a memory")
    _need(_texts(memory.model_id, *memory.given, *memory.settled), "words of a memory")
    _need(len(memory.given) <= MOST_GIVEN and _in(-1.0, 1.0, *memory.given.values()), "given words")
    _check_vectors(memory.examples, memory.reference)
    if match is not None:
        _need(_whole(match.order, match.call_id, match.clock), "a match")
        _check_vectors(match.examples, match.embedding, match.reference)
        _need(_in(-1.0, 1.0, match.similarity), "the similarity of a match")
        _need(match.time is None or _finite(match.time), "the time of a match")
    _check_entries(update.entries)


def _check_entries(entries: Iterable[Entry]) -> None:
    for entry in entries:
        _need(_whole(entry.order, entry.matched, entry.call_id), "a remembered scene's stamps")
        _need(len(entry.refused) <= MAX_REFUSED, "the refused frames of a scene")
        _check_vectors(entry.examples, entry.embedding, entry.surroundings, *entry.refused)
        where = entry.place
        known = (where.latitude, where.longitude, where.heading, where.time, *(where.attitude or ()))
        _need(_finite(*(one for one in known if one is not None)), "a scene's place")


def _check_vectors(examples: Examples, *others: Embedding | None) -> None:
    """Check the tapped words and the vectors of one scene: what is remembered of it has an end."""
    counts, taps = list(map(len, examples.values())), list(chain(*examples.values()))
    _need(len(counts) <= MAX_WORDS and max(counts, default=0) <= MAX_EXAMPLES, "as many examples")
    _need(_texts(*examples, *(one.model_id for one in taps)), "words of examples")
    vectors = [one for one in (*others, *(tap.vector for tap in taps)) if one is not None]
    _need(_vectors(*vectors), "vectors of a scene")
    _need(sum(tap.vector.nbytes for tap in taps) <= LARGEST_EXAMPLES, "examples that are so large")


def _vectors(*vectors: Embedding) -> bool:
    return all(
        vector.ndim == 1 and 0 < vector.size <= LONGEST_VECTOR and bool(np.isfinite(vector).all())
        for vector in vectors
    )


def _past(seconds: float, now: float) -> bool:
    return -math.inf < seconds <= now + _AHEAD


def _finite(*values: float) -> bool:
    return all(map(math.isfinite, values))


def _in(least: float, most: float, *values: float) -> bool:
    return all(least <= value <= most for value in values)


def _shares(*values: float) -> bool:
    return _in(-ROUNDING, 1.0 + ROUNDING, *values)


def _whole(*values: int) -> bool:
    return all(0 <= value <= LARGEST_WHOLE for value in values)


def _texts(*texts: str) -> bool:
    return all(len(text) <= LONGEST_TEXT for text in texts)


def _need(holds: bool, what: str) -> None:
    if not holds:
        raise BadReportError(f"wrong: {what}")
