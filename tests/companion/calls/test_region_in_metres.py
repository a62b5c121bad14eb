"""What calls look at is the region of the frame that was judged: where the ground was at its moment."""

from __future__ import annotations

import numpy as np

from anytraverse.assessment import Assessment, Finding, Maps, Reason
from anytraverse.findings import roi_figures
from anytraverse.frame import Frame
from anytraverse.ground import GroundCamera, GroundRegion
from anytraverse.judging import Settings, Thresholds
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from anytraverse.roi import RoiFigures
from companion.calls.answered_things import AnsweredThings
from companion.calls.cover import Cover
from companion.calls.numbers import Numbers
from companion.calls.thing import Thing

CAMERA = GroundCamera.pinhole(1.0, 7.0, 75.0, 4 / 3, front=0.3)
GROUND = GroundRegion(CAMERA, near=1.5, far=4.0, width=1.4, vehicle=0.6)
NUMBERS = Numbers(
    judging=Settings(
        ground=GROUND, region=GROUND.in_picture(None).region.bounds, thresholds=Thresholds(tile=0.4)
    )
)
NOSE_DOWN = (-4.0, 0.0)
SHAPE = (48, 64)


def seen(lean: tuple[float, float] | None, ahead: float) -> Assessment:
    """A frame of drivable ground with an unknown thing 0.4 m wide on it, its foot so far ahead."""
    camera = CAMERA.leaning(*(lean or (0.0, 0.0)))
    (left, foot), (right, _) = camera.to_picture(np.array([[ahead + 0.3, 0.2], [ahead + 0.3, -0.2]]))
    unknown = Box(left, foot - (right - left), right, foot).mask(*SHAPE)
    uncertainty = np.where(unknown, 0.9, 0.05).astype(np.float32)
    drivable = (1.0 - uncertainty).astype(np.float32)
    named = np.zeros(1, np.bool_)
    maps = Maps(drivable[np.newaxis], drivable, uncertainty, uncertainty, ~unknown, named, ~unknown)
    frame = Frame(1, 0.0, np.full((*SHAPE, 3), 90, np.uint8), lean=lean)
    roi = roi_figures(maps, 4 / 3, NUMBERS.judging.at(lean))
    assert isinstance(roi, RoiFigures)
    bad = Finding(Reason.UNKNOWN_OBJECT, "worst_tile", bad=True, clear=False)
    return Assessment(frame, Preferences.of({"grass": 1.0}), (bad,), 0.1, maps=maps, roi=roi)


def test_a_thing_in_the_region_stays_in_it_when_the_nose_goes_down() -> None:
    inside = seen(NOSE_DOWN, GROUND.far - 0.8)
    level = NUMBERS.judging.at(None).region.mask(*SHAPE)
    assert inside.maps is not None
    assert not (level & ~inside.maps.known).any(), "for a vehicle that does not lean it would be beyond"
    assert Cover([], inside, NUMBERS).beside() > 0.5
    thing = Thing(frozenset({Reason.UNKNOWN_OBJECT}), None)
    thing.mask = ~inside.maps.known
    assert thing.in_roi(inside, NUMBERS).any()


def test_a_thing_in_the_region_is_asked_about_and_then_answered_however_the_vehicle_leans() -> None:
    for lean in (None, NOSE_DOWN, (3.0, 5.0)):
        things = AnsweredThings(NUMBERS)
        frame = seen(lean, 2.8)
        assert Cover([], frame, NUMBERS).beside() > 0.5
        thing, _ = things.asked(frame, frozenset({Reason.UNKNOWN_OBJECT}))
        assert Cover([thing], frame, NUMBERS).beside() < 0.2
