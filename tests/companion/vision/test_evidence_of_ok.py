"""A report of the vision process counts as OK only with the figures that make it OK."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec import structs

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import CORRIDOR, Assessment, Finding, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import first_memory
from anytraverse.preferences import Preferences
from anytraverse.roi import Passage
from companion.vision.checks import BadReportError, Expected
from companion.vision.codec import CodecError
from companion.vision.messages import Done, FrameJudged, Tune
from companion.vision.worker import Worker
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import picture
from tests.companion.vision.played import engine, heard


def judged(thing: str = "", worker: Worker | None = None, number: int = 1) -> FrameJudged:
    """A frame that the engine judged."""
    worker = worker or Worker(engine(None), 1)
    return worker.judge(Frame(number, time.monotonic(), picture(thing)))


CLEAR, DRUM = judged(), judged("drum")
SEEN = CLEAR.assessment
MAPS, ROI = SEEN.maps, SEEN.roi
assert MAPS is not None
assert ROI is not None
assert SEEN.ok


def roi(**changes: Any) -> dict[str, Any]:
    """Other figures of the ROI."""
    assert ROI is not None
    return {"roi": replace(ROI, **changes)}


def told(seen: Assessment, figure: str, **changes: Any) -> dict[str, Any]:
    """Its findings, the one of this figure changed."""
    return {
        "findings": tuple(replace(one, **changes) if one.figure == figure else one for one in seen.findings)
    }


CLOSED = Passage(open=False, passable=False, roomy=False, passable_roomy=False)
LIES: dict[str, tuple[FrameJudged, dict[str, Any]]] = {
    "no maps and no figures, one finding that is clear": (
        CLEAR,
        {"maps": None, "roi": None, "findings": (Finding(Reason.BLOCKED, CORRIDOR, bad=False, clear=True),)},
    ),
    "no finding at all": (CLEAR, {"findings": ()}),
    "a closed corridor that is found open": (CLEAR, roi(corridor=CLOSED)),
    "a value over its limit that is not bad": (
        CLEAR,
        {**roi(uncertainty=0.9), **told(SEEN, "roi_uncertainty", value=0.9)},
    ),
    "a limit of its own": (CLEAR, told(SEEN, "roi_uncertainty", threshold=1.0)),
    "a thing that is found clear": (DRUM, told(DRUM.assessment, "roi_uncertainty", bad=False, clear=True)),
    "a finding less": (DRUM, {"findings": DRUM.assessment.findings[1:]}),
    "an open corridor, and nothing known": (CLEAR, roi(known_share=0.0, drivable_share=None)),
    "an open corridor, and nothing drivable in the maps": (
        CLEAR,
        {"maps": replace(MAPS, drivable=np.zeros_like(MAPS.drivable))},
    ),
    "no words": (CLEAR, {"words": Preferences.of({})}),
    "words of another sign": (CLEAR, {"words": Preferences.parse("grass: 1; rock: 1")}),
    "no tile for the negative words": (
        CLEAR,
        {**roi(named_tile=None), "findings": tuple(f for f in SEEN.findings if "named" not in f.figure)},
    ),
    "no similarity": (
        CLEAR,
        {
            "similarity": None,
            "findings": tuple(one for one in SEEN.findings if one.reason is not Reason.UNKNOWN_SCENE),
        },
    ),
    "a scene more similar than it is": (
        CLEAR,
        {"similarity": 0.2, **told(SEEN, "scene_similarity", value=0.1)},
    ),
    "figures without maps, beside a fault": (
        CLEAR,
        {"maps": None, "findings": (*SEEN.findings, Finding.fault("camera frozen"))},
    ),
    "a fault that is not bad": (
        CLEAR,
        {"findings": (*SEEN.findings, Finding(Reason.FAULT, "x", bad=False, clear=False))},
    ),
}


@pytest.mark.parametrize("lie", LIES.values(), ids=LIES)
def test_an_ok_without_its_evidence_is_nonsense(lie: tuple[FrameJudged, dict[str, Any]]) -> None:
    truth, changes = lie
    heard(truth)
    with pytest.raises(BadReportError):
        heard(structs.replace(truth, assessment=replace(truth.assessment, **changes)))


def test_a_word_beyond_the_words_in_use_is_nonsense() -> None:
    assert ROI is not None
    assert ROI.named_tile is not None
    for word in (len(SEEN.words), 0):  # the first one is drivable
        lie = replace(SEEN, **roi(named_tile=replace(ROI.named_tile, word=word)))
        with pytest.raises(BadReportError, match="word"):
            heard(structs.replace(CLEAR, assessment=lie))


def test_an_outcome_is_computed_again_too() -> None:
    lie = replace(SEEN, **roi(corridor=CLOSED))
    for outcome in (AnswerOutcome(lie, None), AnswerOutcome(None, lie)):
        with pytest.raises(BadReportError):
            heard(Done(1, outcome, "", None))


def test_a_further_fault_is_believed_without_a_figure() -> None:
    worse = replace(SEEN, findings=(*SEEN.findings, Finding.fault("camera frozen")))
    heard(structs.replace(CLEAR, assessment=worse))


def test_a_frame_is_compared_with_the_settings_by_which_it_was_judged() -> None:
    expected, worker = Expected(0, {0: Settings()}), Worker(engine(None), 1)
    strict = Settings(thresholds=Thresholds(roi=0.001, tile=0.25))
    expected.settings[3] = strict
    heard(judged("drum", worker, 1), expected)  # the settings are on their way
    worker.handle(Tune(3, strict))
    after = judged("drum", worker, 2)
    heard(after, expected)
    assert list(expected.settings) == [3]
    for tuning in (0, 4, -1):
        with pytest.raises((CodecError, BadReportError)):
            heard(structs.replace(after, tuning=tuning), Expected(0, {3: strict}))
    with pytest.raises(BadReportError, match="findings"):
        heard(structs.replace(after, tuning=7), Expected(0, {7: Settings()}))


@st.composite
def frames(draw: st.DrawFn) -> tuple[FrameJudged, Settings]:
    """A frame of any maps, judged by any words and thresholds."""
    grain = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    perceiver = Painted()
    perceiver.spoil_attention = lambda maps: grain.choice(
        [0.0, 1.0, 1 / 3, grain.random()], maps.shape
    ).astype(np.float32)
    words = Preferences.of({"grass": 1.0, "rock": float(grain.choice([-1.0, 0.0, 0.5]))})
    limits = Thresholds(roi=draw(st.floats(0.05, 1.0)), tile=draw(st.none() | st.floats(0.05, 1.0)))
    settings = Settings(thresholds=limits)
    worker = Worker(AnyTraverse(perceiver, settings, first_memory(perceiver.model_id, words)), 1)
    return worker.judge(Frame(1, time.monotonic(), picture("drum"))), settings


@pytest.mark.slow
@given(frames(), st.data())
def test_no_frame_becomes_ok_by_other_findings(
    made: tuple[FrameJudged, Settings], data: st.DataObject
) -> None:
    frame, judging = made
    seen = frame.assessment
    heard(frame, Expected(0, {0: judging}))
    assume(not seen.ok)
    kept = data.draw(st.lists(st.booleans(), min_size=len(seen.findings), max_size=len(seen.findings)))
    lie = tuple(
        replace(one, bad=False, clear=not one.bad)
        for one, stays in zip(seen.findings, kept, strict=True)
        if stays
    )
    with pytest.raises(BadReportError):
        heard(structs.replace(frame, assessment=replace(seen, findings=lie)), Expected(0, {0: judging}))
