"""Loads the perceiver and the memory, and runs steps until none is slow because it is the first."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Frame
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import Memory, first_memory, resumed_memory
from anytraverse.pace import Pace
from anytraverse.perception import Perceiver, Prompt, make_perceiver
from anytraverse.roi import Corridor
from anytraverse.synonyms import meaning_of
from companion.config import Config
from companion.config.schema import LONGEST_FRESHNESS
from companion.config.stopping import ground_region, region_of, tile_width

log = logging.getLogger(__name__)

_SIZE = (480, 640)
_STEPS = 5
_LONG_ENOUGH = 5.0
"""Seconds of warming up after which two steps suffice."""
_WORDS = 64
"""Words, beside those in use, that are prepared at most."""
_AT_ONCE = 8
"""Words that are prepared in one call: each takes the memory of a map."""


@dataclass(frozen=True)
class _WarmEngine:
    """Holds a warmed-up engine.

    notices: texts about the memory for the operator. step: seconds of a whole step, the median.
    """

    engine: AnyTraverse
    notices: list[str]
    step: float


def load_and_warm_up(
    config: Config, saved: Memory | None, progress: Callable[[], None] | None = None
) -> _WarmEngine:
    """Load the engine and warm it up. Takes seconds. Raises as `load_engine` does.

    A region that the vehicle does not fit in is allowed: the daemon must run to report that as a fault.
    """
    engine, notices = load_engine(config, saved, progress, misfit_allowed=True)
    remembered = [word for entry in engine.memory.history for word in entry.preferences]
    return _WarmEngine(engine, notices, warm_up(engine, (*config.vocabulary, *remembered)))


def judging_settings(config: Config, perceiver: Perceiver, *, misfit_allowed: bool = False) -> Settings:
    """Combine the config's figures with the perceiver's defaults for those that the config leaves open.

    Raises SettingsError where the vehicle does not fit into the region, unless that is allowed.
    """
    given, own = config.thresholds, Thresholds.of(perceiver.defaults)
    tile = own.tile if given.tile is None else None if given.tile == "off" else float(given.tile)
    thresholds = Thresholds(
        roi=own.roi if given.roi is None else given.roi,
        scene=own.scene if given.scene is None else given.scene,
        tile=tile,
        trav=given.trav,
        margin=config.call.margin,
        similarity_margin=config.call.similarity_margin,
        match=own.match,
    )
    roi, width = config.roi, config.corridor
    settings = Settings(
        region=region_of(config).bounds,
        ground=ground_region(config),
        thresholds=thresholds,
        corridor=Corridor(width.bottom, width.top, bottom_row=width.bottom_row, top_row=width.top_row),
        tile_share=perceiver.defaults.tile_share if roi.tile_share is None else roi.tile_share,
        tile_width=tile_width(config) if roi.tile_share is None else None,
        freshness=config.freshness,
        votes=config.call.votes,
        window=config.call.window,
        scene_every=config.perceiver.scene_every,
        misfit_allowed=misfit_allowed,
    )
    if settings.metres is None:
        return settings
    # Of a region in metres it is known how wide the vehicle appears, also where the ground sets other sides.
    level = settings.at(None).corridor
    return replace(settings, corridor=replace(level, gap=settings.corridor.gap, rows=None))


def load_engine(
    config: Config,
    saved: Memory | None,
    progress: Callable[[], None] | None = None,
    *,
    misfit_allowed: bool = False,
) -> tuple[AnyTraverse, list[str]]:
    """Load the perceiver, and fit the saved memory to it. Returns the engine and notices as in `_WarmEngine`.

    progress: called between the parts of what takes longer than a frame, see `Runtime`.
    Raises AnyTraverseError when the perceiver cannot be made, or cannot ground a configured word, and as
    `judging_settings` does.
    """
    runtime = config.perceiver.runtime
    runtime = runtime if progress is None else replace(runtime, progress=progress)
    perceiver = make_perceiver(config.perceiver.name, runtime)
    memory, notices = _fitted_memory(saved, config, perceiver)
    settings = judging_settings(config, perceiver, misfit_allowed=misfit_allowed)
    return AnyTraverse(perceiver, settings, memory), notices


def warm_up(engine: AnyTraverse, words: Iterable[str] = ()) -> float:
    """Run whole steps on a random image. Return the median of their seconds.

    words: words that may come into use later, from the vocabulary or a remembered scene; they are prepared,
    too. The engine's memory does not change. A perceiver that fails here is only logged: each frame will then
    be a fault, which is reported and holds the vehicle. A companion that does not start does neither.
    """
    image = np.random.default_rng(0).integers(0, 256, (*_SIZE, 3), dtype=np.uint8)
    frame = Frame(0, 0.0, image)
    try:
        _prepare(engine, frame, words)
    except AnyTraverseError as error:
        log.error("the perceiver fails on its first frame: %s", error)
    began, steps = time.monotonic(), list[float]()
    while len(steps) < _STEPS and (len(steps) < 2 or time.monotonic() - began < _LONG_ENOUGH):
        started = time.monotonic()
        try:
            engine.judge(engine.observe(frame), 0.0)
        except AnyTraverseError as error:
            log.debug("warming up: %s", error)
        steps.append(time.monotonic() - started)
    return median(steps)


def too_slow(pace: Pace) -> str:
    """Explain why hold cannot be given with a slow perceiver, and what to do."""
    enough = math.ceil(10.0 * pace.worst_age) / 10.0
    longer = f", or set [call] freshness = {enough:g}" if enough <= LONGEST_FRESHNESS else ""
    return (
        f"hold cannot be given: a frame takes {pace.step:.2f} s, so that what is known of the trail may be "
        f"{pace.worst_age:.2f} s old, more than T = {pace.freshness:.2f} s. Make the perceiver faster (a "
        "bundle of a smaller --size, or with an int8 that `anytraverse bundle check` passed), lower "
        f"[camera] rate, which T follows up to 2 s{longer}"
    )


def _prepare(engine: AnyTraverse, frame: Frame, words: Iterable[str]) -> None:
    perceiver, seen = engine.perceiver, engine.observe(frame)
    # The first use of a word encodes its text, which is slow: better now than while the rover drives.
    others = [word for word in dict.fromkeys(words) if word not in engine.memory.preferences]
    known = [word for word in others if meaning_of(word, perceiver.meaning) is not None]
    for start in range(0, min(_WORDS, len(known)), _AT_ONCE):
        perceiver.attend(seen.features, [Prompt(word) for word in known[start : start + _AT_ONCE]])
    engine.judge(seen, 0.0)


def _fitted_memory(saved: Memory | None, config: Config, perceiver: Perceiver) -> tuple[Memory, list[str]]:
    """Fit the saved memory to model and config. Returns it and notices for the operator."""
    if saved is None:
        return first_memory(perceiver.model_id, config.preferences, config.journal.scenes), []
    return resumed_memory(
        saved,
        perceiver.model_id,
        config.preferences,
        perceiver.meaning,
        history_limit=config.journal.scenes,
    )
