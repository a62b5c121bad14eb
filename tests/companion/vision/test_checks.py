"""What the vision process says is believed only where it can be true."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from msgspec import Raw, structs
from msgspec.msgpack import Ext

from anytraverse.answers import MAX_EXAMPLES, AnswerOutcome
from anytraverse.assessment import Finding, Maps
from anytraverse.frame import Frame, Pose
from anytraverse.grid_map import GridMap
from anytraverse.history import Entry, History, Likeness, Place
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import Adoption
from anytraverse.perception import Example
from anytraverse.preferences import MAX_WORDS, Preferences, Setting
from anytraverse.regions import Box
from anytraverse.roi import Corridor, Tile
from companion.cameras.newest import CameraStatus
from companion.guide.plan import Plan
from companion.vision.checks import LARGEST_MAP, LONGEST_VECTOR, BadReportError, Expected, check_report
from companion.vision.codec import CodecError, decode, pack
from companion.vision.memory_copy import update_from
from companion.vision.messages import (
    LARGEST_JPEG,
    LONGEST_TEXT,
    Alive,
    Done,
    Drawn,
    Encoded,
    Failed,
    FrameJudged,
    GroundMap,
    Logged,
    Model,
    Planned,
    Ready,
    Report,
)
from companion.vision.worker import Worker
from tests.companion.daemon.rig import picture
from tests.companion.vision.played import WORDS, engine, heard

MEMORY = engine(None).memory
UPDATE = update_from(None, MEMORY, 1, 0, ())
READY = Ready(Model("painted-1"), Settings(), UPDATE, ("a notice",), 0.1)
VECTOR = np.ones(2, np.float32)
ENTRY = Entry(VECTOR, WORDS, 1, 1)
LONG, CONTROL = "x" * (LONGEST_TEXT + 1), "\x1b[2J"
NAN, INF = math.nan, math.inf
TAP = Example("painted-1", VECTOR)
TOO_MANY = [f"word {number}" for number in range(MAX_WORDS + 1)]
LARGE = {word: (Example("painted-1", np.ones(LONGEST_VECTOR, np.float32)),) * 11 for word in TOO_MANY[:3]}


def sound(thing: str = "drum") -> FrameJudged:
    """A judged frame, as it comes out of the channel."""
    worker = Worker(engine(None), 1)
    return heard(worker.judge(Frame(5, time.monotonic(), picture(thing))))


def believed(said: object) -> Report:
    """What the supervisor makes of these values, whatever they are."""
    return check_report(decode(pack(said)), Expected(4, {0: Settings()}), time.monotonic())


LOOKED = sound()
SEEN = LOOKED.assessment
MAPS, ROI = SEEN.maps, SEEN.roi
assert MAPS is not None
assert ROI is not None
assert SEEN.observation is not None


def seen(**changes: Any) -> FrameJudged:
    """With another assessment."""
    return structs.replace(LOOKED, assessment=replace(SEEN, **changes))


def looked(**changes: Any) -> FrameJudged:
    """With other fields."""
    return structs.replace(LOOKED, **changes)


def ready(**changes: Any) -> Ready:
    """With other fields."""
    return structs.replace(READY, **changes)


def updating(**changes: Any) -> Ready:
    """With another update of the memory."""
    return structs.replace(READY, update=structs.replace(UPDATE, **changes))


def map_of(value: float, *, name: str = "signed", dtype: Any = np.float32) -> FrameJudged:
    """With one pixel of a map changed."""
    assert MAPS is not None
    changed = np.array(getattr(MAPS, name), dtype=dtype)
    changed[3, 4] = value
    return seen(maps=other_maps(**{name: changed}))


def other_maps(**changes: Any) -> Maps:
    """With these in place of the frame's own."""
    assert MAPS is not None
    return replace(MAPS, **changes)


def maps_of_shape(*shape: int) -> FrameJudged:
    """With maps that all have this shape."""
    values, pixels = (np.broadcast_to(kind(0), shape) for kind in (np.float32, np.bool_))
    figures = {"signed": values, "uncertainty": values, "strangeness": values}
    return seen(maps=other_maps(**figures, drivable=pixels, known=pixels))


def roi_of(**changes: Any) -> FrameJudged:
    """With other figures of the ROI."""
    assert ROI is not None
    return seen(roi=replace(ROI, **changes))


def unmade(kind: type, **given: Any) -> Any:
    """An object that its own class would have refused."""
    value: Any = object.__new__(kind)
    vars(value).update(given)
    return value


def moved(**changes: Any) -> FrameJudged:
    """With another place or lean of the vehicle."""
    return seen(frame=replace(SEEN.frame, **changes))


def ground(**changes: Any) -> GroundMap:
    """A map of the ground."""
    cells = b"\xff" * 40_000
    right = {"at": 1.0, "pose": Pose(1.0, 2.0, 30.0), "corner": (-90, -80)}
    return GroundMap(unmade(GridMap, **{**right, "share": cells, "uncertainty": cells, **changes}))


def planned(**changes: Any) -> Planned:
    """A way round something."""
    right = Plan(
        1.0, Pose(1.0, 2.0, 30.0), 2.5, route_blocked=True, arcs=((0.5, 1.2), (-0.5, 2.0)), clear=3.2, gap=0.4
    )
    return Planned(right._replace(**changes))


CORRIDOR = vars(Settings().corridor)


def settings_of(**changes: Any) -> Ready:
    """With other settings."""
    return ready(settings=unmade(Settings, **{**vars(Settings()), **changes}))


def limits_of(**changes: Any) -> Ready:
    """With other thresholds."""
    return settings_of(thresholds=unmade(Thresholds, **{**vars(Thresholds()), **changes}))


def memory_of(**changes: Any) -> Ready:
    """With another memory."""
    return structs.replace(READY, update=structs.replace(UPDATE, memory=replace(MEMORY, **changes)))


def entry_of(**changes: Any) -> Ready:
    """With a remembered scene."""
    return structs.replace(READY, update=structs.replace(UPDATE, entries=(replace(ENTRY, **changes),)))


def match_of(**changes: Any) -> Ready:
    """With a match whose words are in force."""
    return memory_of(adoption=replace(Adoption(1, 7, 0.9, 3, VECTOR, WORDS, {}, VECTOR), **changes))


def finding_of(**changes: Any) -> FrameJudged:
    """With one finding."""
    given = {**vars(Finding.fault("broken")), **changes}
    return seen(findings=(unmade(Finding, **given),))


AHEAD = time.monotonic() + 1e6
NESTED = Raw(b"\x91" * 100_000 + b"\xc0")
HUGE: Any = Ext(1, b"\xff" * 200)
"""A number too large for a float, as far as there is one: MessagePack has none beyond 64 bits."""
WRONG: dict[str, Any] = {
    "nothing": None,
    "a number": 7,
    "a refused frame that is no vector": entry_of(refused=(None,)),
    "refused frames that are no tuple": entry_of(refused={"0": VECTOR}),
    "more refused frames than are kept": entry_of(refused=(VECTOR,) * 9),
    "a refused frame that is not finite": entry_of(refused=(VECTOR * NAN,)),
    "surroundings that are no vector": entry_of(surroundings=1.5),
    "surroundings that are not finite": entry_of(surroundings=VECTOR * NAN),
    "a match in force that is none": memory_of(adoption=7),
    "a match without a vector": match_of(embedding=None),
    "a match of a similarity beyond 1": match_of(similarity=1.5),
    "a match at no time": match_of(time=NAN),
    "a match with words of the wrong kind": match_of(preferences=[]),
    "a match of a scene without a stamp": match_of(order=-1),
    "a match with a reference that is not finite": match_of(reference=VECTOR * INF),
    "a class": "FrameJudged",
    "a frame that is not newer": structs.replace(
        LOOKED, assessment=replace(SEEN, frame=Frame(4, 1.0, picture()))
    ),
    "a frame's id below 0": seen(frame=Frame(-5, 1.0, picture())),
    "a frame's id that no wire carries": seen(frame=Frame(1 << 32, 1.0, picture())),
    "a frame's id that is no number": seen(frame=Frame("5", 1.0, picture())),  # type: ignore[arg-type]
    "taken in the future": seen(frame=Frame(5, AHEAD, picture())),
    "taken at no time": seen(frame=Frame(5, NAN, picture())),
    "judged in the future": structs.replace(LOOKED, at=AHEAD),
    "judged before it was taken": structs.replace(LOOKED, at=SEEN.frame.captured_at - 1.0),
    "judged at no time": structs.replace(LOOKED, at=NAN),
    "judged in less than no time": structs.replace(LOOKED, duration=-0.1),
    "judged in NaN": structs.replace(LOOKED, duration=NAN),
    "judged in endless time": structs.replace(LOOKED, duration=INF),
    "judged in a time too large for a float": structs.replace(LOOKED, duration=HUGE),
    "a revision below 0": structs.replace(LOOKED, revision=-1),
    "too many sectors": structs.replace(LOOKED, sectors=(0.5,) * 17),
    "a sector of NaN": structs.replace(LOOKED, sectors=(NAN,)),
    "a sector above 1": structs.replace(LOOKED, sectors=(1.1,)),
    "an age of NaN": seen(age=NAN),
    "an endless age": seen(age=INF),
    "a similarity above 1": seen(similarity=1.1),
    "a scene's age of NaN": seen(scene_age=NAN),
    "undecided, perhaps": seen(undecided=1),
    "alike, without saying what": seen(likeness=(3, 0.9, 0.95)),
    "alike a scene of no call": seen(likeness=Likeness(-1, 0.9, 0.95)),
    "alike by NaN": seen(likeness=Likeness(3, NAN, 0.95)),
    "alike by a text": seen(likeness=Likeness(3, 0.9, "0.95")),  # type: ignore[arg-type]
    "words that are none": seen(words={"grass": 1.0}),
    "a weight above 1": seen(
        words=unmade(Preferences, _settings={"grass": Setting(1.0), "rock": Setting(2.0)})
    ),
    "words without a weight": seen(words={"grass": {"order": 0}}),
    "a finding that is none": seen(findings=("fault",)),
    "findings that are no tuple": seen(findings={"0": Finding.fault("x")}),
    "more weak words than may be in use": updating(weak=("grass",) * (MAX_WORDS + 1)),
    "more taps of a word than are kept": memory_of(examples={"gnome": (TAP,) * (MAX_EXAMPLES + 1)}),
    "more taps of a scene's word than are kept": entry_of(examples={"gnome": (TAP,) * (MAX_EXAMPLES + 1)}),
    "more tapped words than may be in use": entry_of(examples=dict.fromkeys(TOO_MANY, (TAP,))),
    "a tap of a model without an end": entry_of(examples={"gnome": (Example(LONG, VECTOR),)}),
    "what a match replaced is too large": match_of(examples=LARGE),
    "a scene that is too large": entry_of(examples=LARGE),
    "a scene of now that is too large": memory_of(examples=LARGE),
    "no reason": finding_of(reason="fault"),
    "bad and clear": finding_of(bad=True, clear=True),
    "bad, perhaps": finding_of(bad=1),
    "a figure that is no text": finding_of(figure=7),
    "a value that is no number": finding_of(value="0.5"),
    "a value too large for a float": finding_of(value=HUGE),
    "a map of NaN": map_of(NAN),
    "an endless map": map_of(INF),
    "signed above 1": map_of(1.5),
    "signed below -1": map_of(-1.5),
    "uncertainty of NaN": map_of(NAN, name="uncertainty"),
    "uncertainty below 0": map_of(-0.5, name="uncertainty"),
    "strangeness above 1": map_of(1.5, name="strangeness"),
    "a map of doubles": map_of(0.5, dtype=np.float64),
    "a map that is a list": seen(maps=other_maps(uncertainty=[0.5])),
    "maps of two shapes": seen(maps=other_maps(signed=np.zeros((2, 2), np.float32))),
    "flat maps": maps_of_shape(4),
    "empty maps": maps_of_shape(0, 4),
    "huge maps": maps_of_shape(LARGEST_MAP, 2),
    "names of other words": seen(maps=other_maps(named=np.zeros(9, np.bool_))),
    "traversability of NaN": roi_of(traversability=NAN),
    "uncertainty of an ROI above 1": roi_of(uncertainty=1.5),
    "a tile that is asked about above 1": seen(asked=Tile(Box(0, 0, 1, 1), 1.5)),
    "a tile that is asked about of NaN": seen(asked=Tile(Box(0, 0, 1, 1), NAN)),
    "an observation of another frame": seen(
        observation=replace(SEEN.observation, frame=Frame(4, 1.0, picture()))
    ),
    "a depth, which is left out": seen(frame=replace(SEEN.frame, depth=np.zeros((40, 60), np.uint16))),
    "intrinsics, which are left out": seen(frame=replace(SEEN.frame, intrinsics=(5.0, 5.0, 3.0, 3.0))),
    "features, which are left out": seen(observation=replace(SEEN.observation, features=1)),
    "a drivable share above 1": roi_of(drivable_share=1.5),
    "no tile": roi_of(worst_tile=None),
    "a corridor of text": roi_of(corridor="open"),
    "a named tile that is none": roi_of(named_tile=(1, 2)),
    "a match that is none": seen(match="entry"),
    "an observation that is none": seen(observation=SEEN.frame),
    "an update that is none": looked(update={}),
    "infrared that is a number": looked(infrared=1),
    "infrared that is a text": looked(infrared="yes"),
    "a model whose infrared is no bool": ready(model=Model("painted-1", infrared=cast(bool, 1.0))),
    "a revision that is no number": updating(revision="1"),
    "a base below 0": updating(base=-1),
    "a limit that is no number": memory_of(history=unmade(History, limit=None)),
    "a limit below 0": memory_of(history=unmade(History, limit=-1)),
    "a removed row that is no stamp": updating(removed=("1",)),
    "a weak word that is none": updating(weak=(1,)),
    "a reference of NaN": memory_of(reference=np.array([NAN, 1], np.float32)),
    "a reference of doubles": memory_of(reference=np.array([0.0, 1.0])),
    "a reference of rows": memory_of(reference=np.ones((2, 2), np.float32)),
    "no model": memory_of(model_id=None),
    "words of a memory that are none": memory_of(preferences={"grass": 1.0}),
    "given words that are none": memory_of(given={1: 1.0}),
    "more given words than there may be": memory_of(given={f"kind {one}": 1.0 for one in range(257)}),
    "a given weight that is no number": memory_of(given={"mud": "1"}),
    "a given weight above 1": memory_of(given={"mud": 1.5}),
    "a given weight of NaN": memory_of(given={"mud": NAN}),
    "stamps that are none": memory_of(settled={"grass": "now"}),
    "a clock below 0": memory_of(clock=-1),
    "a clock that the journal cannot store": memory_of(clock=1 << 63),
    "a scene's stamp that the journal cannot store": entry_of(order=(1 << 53) + 1),
    "an empty reference": memory_of(reference=np.zeros(0, np.float32)),
    "a reference of millions": memory_of(reference=np.zeros(1 << 20, np.float32)),
    "an empty example": memory_of(examples={"gnome": (Example("painted-1", np.zeros(0, np.float32)),)}),
    "an empty refused frame": entry_of(refused=(np.zeros(0, np.float32),)),
    "a step of hours": ready(step=3600.0),
    "an example that is none": memory_of(examples={"gnome": (VECTOR,)}),
    "a scene of NaN": entry_of(embedding=np.array([NAN, 1], np.float32)),
    "a scene of text": entry_of(embedding="scene"),
    "a scene's stamp below 0": entry_of(order=-1),
    "a scene at no place": entry_of(place=None),
    "a scene at a latitude of text": entry_of(place=Place("47", 8.0)),  # type: ignore[arg-type]
    "a scene at a latitude of NaN": entry_of(place=Place(NAN, 8.0)),
    "a scene with two angles": entry_of(place=Place(attitude=(1.0, 2.0))),  # type: ignore[arg-type]
    "ready without a model": ready(model="painted-1"),
    "ready without settings": ready(settings=None),
    "settings out of range": structs.replace(
        READY, settings=unmade(Settings, **{**vars(Settings()), "freshness": NAN})
    ),
    "a tile that may be": settings_of(tile_width=True),
    "a tile of an array": settings_of(tile_share=np.array([0.1])),
    "a region that is none": settings_of(region=(0.3, 0.6, 0.7, 0.9)),
    "no thresholds": settings_of(thresholds=None),
    "a threshold of NaN": limits_of(roi=NAN),
    "a threshold of text": limits_of(scene="0.8"),
    "a match without pairs": limits_of(match=0.9),
    "a match by NaN": limits_of(match=((1, NAN),)),
    "a match by text": limits_of(match=((1, "a"),)),
    "a match that falls": limits_of(match=((1, 0.9), (40, 0.8))),
    "a match with endless scenes": limits_of(match=((1, 0.8), (INF, 0.9))),
    "two matches for as many scenes": limits_of(match=((1, 0.8), (1, 0.9))),
    "a corridor without gaps": settings_of(corridor=unmade(Corridor, **{**CORRIDOR, "gap": 0.0})),
    "a corridor with a gap of NaN": settings_of(corridor=unmade(Corridor, **{**CORRIDOR, "gap": NAN})),
    "a corridor at no two rows": settings_of(corridor=unmade(Corridor, **{**CORRIDOR, "top_row": 0.95})),
    "a region narrower than the vehicle": settings_of(corridor=Corridor(0.9, 0.9)),
    "a region that may be narrower": settings_of(misfit_allowed=1),
    "settings of a region without a side": settings_of(region={"left": 0.3, "top": 0.6, "right": 0.7}),
    "a step of NaN": structs.replace(READY, step=NAN),
    "an endless step": structs.replace(READY, step=INF),
    "a step below 0": structs.replace(READY, step=-1.0),
    "a step too large for a float": structs.replace(READY, step=HUGE),
    "a notice too long": structs.replace(READY, notices=(LONG,)),
    "a camera that is none": Alive(None, 1.0),  # type: ignore[arg-type]
    "a camera in no state": Alive(CameraStatus(state="ok"), 1.0),  # type: ignore[arg-type]
    "a count of text": Alive(CameraStatus(read="many"), 1.0),  # type: ignore[arg-type]
    "a reason too long": Alive(CameraStatus(reason=LONG), 1.0),
    "a depth that may be": Alive(CameraStatus(depth=1), 1.0),  # type: ignore[arg-type]
    "a lens without a focal length": Alive(CameraStatus(intrinsics=(0.0, 1.0, 2.0, 3.0)), 1.0),
    "a lens that is no number": Alive(CameraStatus(intrinsics=(5.0, 5.0, NAN, 3.0)), 1.0),
    "a lens of arrays": Alive(CameraStatus(intrinsics=(np.ones(1, np.float32),) * 4), 1.0),  # type: ignore[arg-type]
    "a lens that may be": Alive(CameraStatus(intrinsics=(True, True, True, True)), 1.0),
    "a lens of three": Alive(CameraStatus(intrinsics=(5.0, 5.0, 3.0)), 1.0),  # type: ignore[arg-type]
    "a frame that came in the future": Alive(CameraStatus(), AHEAD),
    "a frame that came at no time": Alive(CameraStatus(), NAN),
    "a frame that came at a time too large for a float": Alive(CameraStatus(), HUGE),
    "a square around a tile that is none": roi_of(
        worst_tile=unmade(Tile, box=Box(0, 0, 1, 1), uncertainty=0.5, around=(0, 0, 1, 1))
    ),
    "a square around a tile that leaves the picture": roi_of(
        worst_tile=Tile(Box(0, 0, 1, 1), 0.5, unmade(Box, left=0.0, top=0.0, right=2.0, bottom=1.0))
    ),
    "a box of what is nested too deep": roi_of(worst_tile=Tile(unmade(Box, left=NESTED), 0.5)),
    "an outcome and an error": Done(1, AnswerOutcome(None, None), "no", None),
    "neither outcome nor error": Done(1, None, "", None),
    "an outcome that is none": Done(1, "fine", "", None),  # type: ignore[arg-type]
    "a number below 0": Done(-1, None, "no", None),
    "a call's frame of the future": Done(
        1, AnswerOutcome(replace(SEEN, frame=Frame(1, AHEAD, picture())), None), "", None
    ),
    "dropped words that are none": Done(1, AnswerOutcome(None, None, dropped=(1,)), "", None),  # type: ignore[arg-type]
    "a picture of text": Drawn(1, 2, "t", panel="jpeg"),  # type: ignore[arg-type]
    "a title too long": Drawn(1, 2, LONG),
    "an encoded frame of text": Encoded(1, 2, "jpeg"),  # type: ignore[arg-type]
    "an encoded frame that is too large": Encoded(1, 2, bytes(LARGEST_JPEG + 1)),
    "an encoded frame without a number": Encoded(-1, 2),
    "a line of no level": Logged("error", "name", "text"),  # type: ignore[arg-type]
    "a line too long": Logged(40, "name", LONG),
    "a line of a level beyond those there are": Logged(51, "name", "text"),
    "a failure that controls a terminal": Failed(f"text{CONTROL}"),
    "an error of two lines": Done(1, None, "no\nERROR yes", None),
    "a notice that controls a terminal": ready(notices=(CONTROL,)),
    "a model that controls a terminal": ready(model=Model(CONTROL)),
    "a reason that controls a terminal": Alive(CameraStatus(reason=CONTROL), 1.0),
    "a figure that controls a terminal": finding_of(figure=CONTROL),
    "a dropped word that controls a terminal": Done(1, AnswerOutcome(None, None, (CONTROL,)), "", None),
    "a weak word that controls a terminal": updating(weak=(CONTROL,)),
    "a given word that controls a terminal": memory_of(given={CONTROL: 1.0}),
    "a tapped word that controls a terminal": entry_of(examples={CONTROL: (TAP,)}),
    "a pose that is nowhere": moved(pose=Pose(NAN, 0.0, 0.0)),
    "a pose of two numbers": moved(pose=(1.0, 2.0)),
    "a lean upside down": moved(lean=(170.0, 0.0)),
    "a reach behind the vehicle": moved(reach=-1.0),
    "a reach beyond what is known": moved(reach=7.0),
    "a map of the ground of the future": ground(at=AHEAD),
    "a map of the ground at no time": ground(at=NAN),
    "a map of the ground nowhere": ground(pose=Pose(0.0, NAN, 0.0)),
    "a map of the ground too far away": ground(corner=(1 << 60, 0)),
    "a map of the ground with too few cells": ground(share=b"1"),
    "a map of the ground with too many cells": ground(uncertainty=b"1" * 40_001),
    "a map of the ground of a text": ground(share="text"),
    "a way planned in the future": planned(at=AHEAD),
    "a way planned at no time": planned(at=NAN),
    "a way that begins nowhere": planned(pose=Pose(0.0, 0.0, INF)),
    "a way that leads on for ever": planned(clear=INF),
    "a way that is longer than the ground is known": planned(arcs=((0.0, 7.0),), clear=7.0),
    "a way of other length than its arcs": planned(clear=3.0),
    "a way without arcs that leads somewhere": planned(arcs=()),
    "a way of three arcs": planned(arcs=((0.0, 1.0),) * 3, clear=3.0),
    "a way of an arc without a length": planned(arcs=((0.0,),)),
    "a way of no arcs at all": planned(arcs=None),
    "a way that turns on the spot": planned(arcs=((50.0, 3.2),)),
    "a way that turns by no number": planned(arcs=((NAN, 3.2),)),
    "a way backwards": planned(arcs=((0.0, -1.0), (0.0, 4.2))),
    "a mission's way that leads back": planned(route_clear=-1.0),
    "a way that may be blocked": planned(route_blocked=None),
    "a way wider than the grid": planned(gap=50.0),
    "a way of no width": planned(gap=NAN),
    "a failure of bytes": Failed(b"text"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_what_cannot_be_true_is_refused(wrong: Any) -> None:
    with pytest.raises((CodecError, BadReportError)):
        believed(wrong)


@pytest.mark.parametrize(
    "said",
    [
        LOOKED,
        READY,
        entry_of(),
        memory_of(reference=VECTOR),
        Alive(CameraStatus(), None),
        Alive(CameraStatus(depth=True, intrinsics=(500.0, 500.0, 320.5, 240.5)), 1.0),
        Done(1, None, "no", None),
        Done(1, AnswerOutcome(SEEN, None), "", UPDATE),
        Drawn(1, 2, "t"),
        Logged(40, "name", "text"),
        moved(lean=(3.0, -2.0), pose=Pose(5.0, -6.0, 90.0), reach=5.5),
        ground(),
        planned(),
        planned(arcs=((0.5, 3.2),)),
        planned(arcs=(), clear=0.0, gap=0.0),
        Failed("text"),
    ],
)
def test_what_can_be_true_is_believed(said: Any) -> None:
    assert pack(believed(said)) == pack(said)


def test_frames_rise_and_one_that_is_refused_counts_for_nothing() -> None:
    expected = Expected(4, {0: Settings()})
    with pytest.raises(BadReportError):
        check_report(seen(frame=Frame(9, AHEAD, picture())), expected, time.monotonic())
    check_report(LOOKED, expected, time.monotonic())
    assert expected.last_frame == 5
    with pytest.raises(BadReportError, match="frame 5 after 5"):
        check_report(LOOKED, expected, time.monotonic())


@pytest.mark.parametrize(
    "message", [LOOKED, READY, Alive(CameraStatus(), 1.0), Drawn(1, 2, "t"), Logged(1, "a", "b")]
)
def test_a_field_that_is_missing_or_something_else_is_refused(message: Any) -> None:
    kind, given = type(message).__name__, structs.astuple(message)
    assert pack(believed([kind, *given])) == pack(message)
    for at in range(len(given)):
        with pytest.raises((CodecError, BadReportError)):
            believed([kind, *given[:at], *given[at + 1 :]])
        for broken in (Ext(1, b""), {7: 7}):
            with pytest.raises((CodecError, BadReportError)):
                believed([kind, *given[:at], broken, *given[at + 1 :]])


@pytest.mark.parametrize(
    "message",
    [structs.replace(READY, settings={}), Alive({}, 1.0)],  # type: ignore[arg-type]
)
def test_a_part_without_its_fields_is_refused(message: Any) -> None:
    with pytest.raises((CodecError, BadReportError)):
        believed(message)
