"""Checks every report of the vision process before it is used: types, sizes, ranges, finite numbers."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, field, replace
from typing import Any

import numpy as np

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment, Finding, Maps, Observation, Reason
from anytraverse.frame import is_intrinsics
from anytraverse.history import MAX_REFUSED, Entry, History, Likeness, Place, is_embedding
from anytraverse.judging import Settings, Thresholds
from anytraverse.light import Light
from anytraverse.memory import MOST_GIVEN, Adoption, Memory
from anytraverse.perception import Example
from anytraverse.preferences import MAX_WORDS, Preferences
from anytraverse.regions import Box
from anytraverse.roi import Corridor, NamedTile, Passage, RoiFigures, Tile
from companion.cameras.newest import CameraState, CameraStatus
from companion.vision.evidence import contradiction
from companion.vision.freeze_detector import CELLS
from companion.vision.messages import (
    LARGEST_JPEG,
    LONGEST_TEXT,
    MOST_ROWS,
    Alive,
    Done,
    Drawn,
    Encoded,
    Failed,
    FrameJudged,
    Logged,
    MemoryUpdate,
    Model,
    Ready,
    Report,
    Scenes,
)

LARGEST_MAP = 4 << 20
"""Pixels of one map, at most."""
_AHEAD = 0.001
"""Seconds by which a time stamp of the vision process may lie in the future, because of rounding."""
_ROUNDING = 1e-6
_U32 = 0xFFFFFFFF
MOST_TUNINGS = 256
"""Settings by which the next frame may have been judged, at most."""
_LARGEST_WHOLE = 1 << 53


class BadReportError(Exception):
    """A report has an impossible value: the process that sent it can no longer be trusted."""


@dataclass
class Expected:
    """Holds what the next report is compared with.

    last_frame: id of the newest frame reported so far. settings: those by which frames may have been judged,
    by the number of their `Tune`, the oldest first.
    """

    last_frame: int
    settings: dict[int, Settings] = field(default_factory=lambda: {0: Settings()})

    def settings_of(self, tuning: Any) -> Settings:
        """Return the settings of a `Tune`; earlier ones do not come any more. Raises BadReportError."""
        _need(_whole(tuning) and tuning in self.settings, "by which settings it was judged")
        self.settings = {number: one for number, one in self.settings.items() if number >= tuning}
        return self.settings[tuning]


def check_report(message: Any, expected: Expected, now: float) -> Report:
    """Check a report and return it. Raises BadReportError. now: monotonic seconds."""
    try:
        _check(message, expected, now)
    except BadReportError:
        raise
    except Exception as error:  # the fields may hold any type, so that checking them may raise anything
        raise BadReportError(f"wrong: {error!r}") from error
    report: Report = message
    return report


def _check(message: Any, expected: Expected, now: float) -> None:
    match message:
        case FrameJudged():
            _check_frame_judged(message, expected, now)
        case Done(number, outcome, error, update, tuning):
            _need(_whole(number) and _text(error), "a number and a text")
            _need((outcome is None) == bool(error), "an outcome or an error")
            if outcome is not None:
                _check_outcome(outcome, expected.settings_of(tuning), now)
            if update is not None:
                _check_update(update)
        case Ready(model, settings, update, notices, step):
            _need(
                isinstance(model, Model) and all(map(_text, (model.id, model.precision, model.why))),
                "a model",
            )
            _need(isinstance(model.infrared, bool), "whether a model handles infrared")
            _check_settings(settings)
            _need(isinstance(notices, tuple) and all(map(_text, notices)), "notices")
            _need(_seconds(step), "seconds of a step")
            _check_update(update)
        case Alive(camera, delivered_at):
            right = isinstance(camera, CameraStatus) and isinstance(camera.state, CameraState)
            counts = camera.read, camera.dropped, camera.refused, camera.connected
            _need(right and _text(camera.reason) and all(map(_whole, counts)), "the state of a camera")
            _need(_whole(camera.width) and _whole(camera.height), "the size of a camera's pictures")
            _need(_text(camera.timed_by), "what capture times are from")
            intrinsics = camera.intrinsics
            _need(isinstance(camera.depth, bool), "whether a camera measures depth")
            _need(intrinsics is None or is_intrinsics(intrinsics), "the intrinsics of a camera")
            _need(delivered_at is None or _past(delivered_at, now), "when a frame came")
        case Drawn():
            texts_fit = _text(message.title) and _whole(message.number) and _whole(message.frame_id)
            pictures = (message.panel, message.thumbnail, message.png, message.raw)
            right = all(isinstance(one, bytes) for one in pictures) and isinstance(message.stored, bool)
            _need(texts_fit and right, "pictures")
        case Encoded(number, frame_id):
            encoded = (message.picture, message.traversability, message.uncertainty)
            fit = all(isinstance(one, bytes) and len(one) <= LARGEST_JPEG for one in encoded)
            _need(_whole(number) and _whole(frame_id) and fit, "a frame for the recording")
        case Logged(level, name, text):
            _need(_whole(level) and _text(name) and _text(text), "a line of the log")
        case Failed(text):
            _need(_text(text), "a text")
        case Scenes(entries):
            _check_rows(entries)
        case _:
            raise BadReportError(f"no report but {type(message).__name__}")


def _check_settings(settings: Any) -> None:
    _need(isinstance(settings, Settings) and isinstance(settings.region, Box), "settings")
    limits, corridor = settings.thresholds, settings.corridor
    _need(isinstance(limits, Thresholds) and isinstance(corridor, Corridor), "thresholds and a corridor")
    _need(isinstance(limits.match, tuple), "the numbers for matches")
    for scenes, least in limits.match:
        _need(_whole(scenes) and scenes <= _U32 and _number(least), "the numbers for matches")
    _need(isinstance(settings.misfit_allowed, bool), "whether the region may be too narrow")
    one_by_one = {**vars(limits), **vars(corridor), **vars(settings)}
    for name in ("match", "thresholds", "corridor", "region", "pooling", "uncertainty", "misfit_allowed"):
        del one_by_one[name]
    for name, value in one_by_one.items():
        _need(_number(value) or (value is None and name in ("tile", "tile_width")), f"the setting {name}")
    for part in (settings.region, limits, corridor, settings):
        replace(part)  # runs the checks of __post_init__, which decoding has skipped


def _check_frame_judged(judged: FrameJudged, expected: Expected, now: float) -> None:
    seen = judged.assessment
    _check_assessment(seen, expected.settings_of(judged.tuning), now)
    _need(seen.similarity is not None or not seen.ok, "OK without a similarity")
    _need(seen.frame.id > expected.last_frame, f"frame {seen.frame.id} after {expected.last_frame}")
    _need(_past(judged.at, now) and judged.at >= seen.frame.captured_at, "when a frame was judged")
    _need(_seconds(judged.duration), "seconds of judging")
    _need(_whole(judged.revision), "a revision")
    _need(isinstance(judged.sectors, tuple) and len(judged.sectors) <= 16, "sectors")
    _need(all(share is None or _fraction(share) for share in judged.sectors), "a sector's share")
    still = judged.luma
    right = isinstance(still, np.ndarray) and still.dtype == np.float32 and still.shape == CELLS[::-1]
    _need(right and bool(np.isfinite(still).all()), "a picture's luma")
    _need(judged.infrared is None or isinstance(judged.infrared, bool), "whether the camera shows infrared")
    if judged.update is not None:
        _check_update(judged.update)
    expected.last_frame = seen.frame.id


def _check_outcome(outcome: Any, settings: Settings, now: float) -> None:
    _need(isinstance(outcome, AnswerOutcome), "an outcome")
    _need(all(map(_text, outcome.dropped)) and isinstance(outcome.remembered, bool), "what an answer changed")
    _need(all(map(_text, outcome.undone)) and all(map(_whole, outcome.forgotten)), "what a refusal changed")
    for seen in (outcome.call, outcome.newest):
        if seen is not None:
            _check_assessment(seen, settings, now)


def _check_assessment(seen: Any, settings: Settings, now: float) -> None:
    _need(isinstance(seen, Assessment), "an assessment")
    _need(_whole(seen.frame.id) and seen.frame.id <= _U32, "a frame's id")
    _need(_past(seen.frame.captured_at, now), "when a frame was taken")
    _check_words(seen.words)
    _need(all(map(_text, seen.dropped)), "words")
    _need(_number(seen.age) and math.isfinite(seen.age), "a frame's age")
    _need(
        seen.similarity is None or (_number(seen.similarity) and -1.0 <= seen.similarity <= 1.0),
        "a similarity",
    )
    _need(_number(seen.scene_age) and math.isfinite(seen.scene_age), "a scene's age")
    _need(isinstance(seen.undecided, bool), "whether a scene is undecided")
    if seen.likeness is not None:
        like = seen.likeness
        _need(isinstance(like, Likeness) and _whole(like.call_id), "the scene that a frame is most nearly")
        cosines = like.similarity, like.needed
        _need(all(_number(one) and -1.0 <= one <= 1.0 for one in cosines), "how much a scene is alike")
    if seen.light is not None:
        _need(isinstance(seen.light, Light), "a picture's light")
        levels = seen.light.mean, seen.light.darkest
        _need(all(_number(one) and 0.0 <= one <= 256.0 for one in levels), "a picture's light")
    _need(isinstance(seen.findings, tuple), "findings")
    for finding in seen.findings:
        _check_finding(finding)
    if seen.maps is not None:
        _check_maps(seen.maps, len(seen.words))
    if seen.roi is not None:
        _check_roi(seen.roi)
    if seen.observation is not None:
        _need(isinstance(seen.observation, Observation), "an observation")
        embedding = seen.observation.embedding
        _need(isinstance(embedding, np.ndarray) and embedding.dtype == np.float32, "an embedding")
    for entry in (seen.adopted, seen.match.entry if seen.match is not None else None):
        if entry is not None:
            _check_entry(entry)
    wrong = contradiction(seen, settings)
    _need(not wrong, wrong)


def _check_finding(finding: Any) -> None:
    right = isinstance(finding, Finding) and isinstance(finding.reason, Reason) and _text(finding.figure)
    _need(right and isinstance(finding.bad, bool) and isinstance(finding.clear, bool), "a finding")
    _need(not (finding.bad and finding.clear), "a finding that is bad and clear")
    _need(_number(finding.value) and _number(finding.threshold), "a finding's figures")


def _check_maps(maps: Any, words: int) -> None:
    _need(isinstance(maps, Maps), "maps")
    shape = maps.signed.shape
    _need(len(shape) == 2 and 0 < maps.signed.size <= LARGEST_MAP, f"maps of shape {shape}")
    for name, lowest in (("signed", -1.0), ("uncertainty", 0.0), ("strangeness", 0.0)):
        one = getattr(maps, name)
        right = isinstance(one, np.ndarray) and one.dtype == np.float32 and one.shape == shape
        _need(right and bool(np.isfinite(one).all()), f"the map {name}")
        _need(float(one.min()) >= lowest and float(one.max()) <= 1.0, f"values of the map {name}")
    for name, right_shape in (("drivable", shape), ("known", shape), ("named", (words,))):
        one = getattr(maps, name)
        right = isinstance(one, np.ndarray) and one.dtype == np.bool_ and one.shape == right_shape
        _need(right, f"the map {name}")


def _check_roi(roi: Any) -> None:
    _need(isinstance(roi, RoiFigures) and isinstance(roi.corridor, Passage), "a corridor")
    way = roi.corridor
    open_or_not = (way.open, way.passable, way.roomy, way.passable_roomy)
    _need(all(isinstance(one, bool) for one in open_or_not), "a corridor")
    _need(way.open <= way.passable and way.roomy <= way.open, "a corridor that is open and not passable")
    shares = [way.explained, roi.uncertainty, roi.strangeness, roi.traversability, roi.known_share]
    tiles, named = [roi.worst_tile, *([] if way.gap is None else [way.gap])], roi.named_tile
    if named is not None:
        _need(isinstance(named, NamedTile) and _whole(named.word), "a named tile")
        tiles.append(named.tile)
        shares.append(named.explained)
    for tile in tiles:
        _need(isinstance(tile, Tile) and isinstance(tile.box, Box), "a tile's box")
        _need(tile.around is None or isinstance(tile.around, Box), "the square around a tile")
        shares += [tile.uncertainty, *astuple(tile.box), *(astuple(tile.around) if tile.around else ())]
    _need(all(_fraction(share) for share in shares), "figures of the ROI")
    _need(roi.drivable_share is None or _fraction(roi.drivable_share), "a drivable share")


def _check_update(update: Any) -> None:
    _need(isinstance(update, MemoryUpdate) and isinstance(update.memory, Memory), "a memory")
    _need(all(map(_whole, (update.revision, update.base, update.limit, update.memory.clock))), "a revision")
    memory = update.memory
    _need(_text(memory.model_id) and isinstance(memory.history, History), "a memory")
    _check_words(memory.preferences)
    _check_words(memory.configured)
    given = memory.given
    _need(isinstance(given, dict) and len(given) <= MOST_GIVEN and all(map(_text, given)), "given words")
    _need(all(_number(one) and -1.0 <= one <= 1.0 for one in given.values()), "the weight of a given word")
    _need(memory.reference is None or _is_vector(memory.reference), "a reference")
    _need(all(_text(word) and _whole(at) for word, at in memory.settled.items()), "stamps of words")
    _check_examples(memory.examples)
    if memory.adoption is not None:
        _check_adoption(memory.adoption)
    _check_rows(update.entries)
    _need(all(map(_whole, update.removed)) and all(map(_text, update.weak)), "rows of a memory")


def _check_rows(entries: Any) -> None:
    _need(isinstance(entries, tuple) and len(entries) <= MOST_ROWS, "rows of a memory")
    for entry in entries:
        _check_entry(entry)


def _check_entry(entry: Any) -> None:
    _need(isinstance(entry, Entry) and _is_vector(entry.embedding), "a remembered scene")
    _need(all(map(_whole, (entry.order, entry.matched, entry.call_id))), "a remembered scene's stamps")
    _check_words(entry.preferences)
    _check_examples(entry.examples)
    right = isinstance(entry.refused, tuple) and len(entry.refused) <= MAX_REFUSED
    _need(right and all(map(_is_vector, entry.refused)), "the refused frames of a scene")
    _need(entry.surroundings is None or _is_vector(entry.surroundings), "a scene's surroundings")
    where = entry.place
    _need(isinstance(where, Place) and len(where.attitude or (0, 0, 0)) == 3, "a remembered scene's place")
    known = (where.latitude, where.longitude, where.heading, where.time, *(where.attitude or ()))
    _need(all(one is None or (_number(one) and math.isfinite(one)) for one in known), "a scene's place")


def _check_adoption(one: Any) -> None:
    _need(isinstance(one, Adoption) and all(map(_whole, (one.order, one.call_id, one.clock))), "a match")
    _need(_is_vector(one.embedding) and (one.reference is None or _is_vector(one.reference)), "its vectors")
    _need(_number(one.similarity) and -1.0 <= one.similarity <= 1.0, "the similarity of a match")
    _need(one.time is None or (_number(one.time) and math.isfinite(one.time)), "the time of a match")
    _check_words(one.preferences)
    _check_examples(one.examples)


def _check_words(words: Any) -> None:
    _need(isinstance(words, Preferences) and len(words) <= MAX_WORDS, "words")
    for word, weight in words.items():
        _need(_text(word) and _number(weight) and -1.0 <= weight <= 1.0, "a word's weight")
        _need(_whole(words.order(word)), "a word's stamp")


def _check_examples(examples: Any) -> None:
    for word, taps in examples.items():
        _need(
            _text(word) and all(isinstance(one, Example) and _is_vector(one.vector) for one in taps), "taps"
        )


def _is_vector(vector: Any) -> bool:
    right = isinstance(vector, np.ndarray) and vector.dtype == np.float32 and vector.ndim == 1
    return right and (is_embedding(vector) or bool(np.isfinite(vector).all()))


def _past(seconds: Any, now: float) -> bool:
    return _number(seconds) and math.isfinite(seconds) and seconds <= now + _AHEAD


def _seconds(value: Any) -> bool:
    return _number(value) and 0.0 <= value < math.inf


def _fraction(value: Any) -> bool:
    return _number(value) and -_ROUNDING <= value <= 1.0 + _ROUNDING


def _number(value: Any) -> bool:
    """Whether it is a float, or a whole number that a float holds exactly."""
    if isinstance(value, int) and not isinstance(value, bool):
        return abs(value) <= _LARGEST_WHOLE
    return isinstance(value, float)


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST_TEXT


def _need(holds: bool, what: str) -> None:
    if not holds:
        raise BadReportError(f"wrong: {what}")
