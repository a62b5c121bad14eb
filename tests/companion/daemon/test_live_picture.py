"""A picture for somebody who watches: of the newest frame, one at a time, and beside those of calls."""

from __future__ import annotations

from companion.daemon.live_picture import ShownFrame
from companion.vision.messages import Draw
from tests.companion.daemon.rig import MakeRig, Rig


def draws(rig: Rig) -> list[Draw]:
    return [request for request in rig.child.requests if isinstance(request, Draw)]


def shown(rig: Rig) -> ShownFrame:
    picture = rig.daemon.live_picture.take()
    assert picture is not None
    return picture


def test_nothing_is_drawn_for_nobody(rig: Rig) -> None:
    rig.see(2.0)
    assert draws(rig) == []
    assert rig.daemon.live_picture.take() is None


def test_each_wish_is_one_picture_of_the_next_judged_frame(rig: Rig) -> None:
    rig.see(1.0)
    rig.daemon.live_picture.want()
    rig.daemon.live_picture.want()
    last = rig.frame_id
    rig.see(1.0)
    picture = shown(rig)
    assert picture.frame in (last + 1, last + 2)
    assert picture.jpeg.startswith(b"\xff\xd8")
    assert 0.0 <= rig.clock.now - picture.captured_at < 1.2
    assert rig.daemon.live_picture.take() is None
    (draw,) = draws(rig)
    assert draw.title == "OK"
    assert not draw.store


def test_it_is_no_picture_of_a_call_and_a_call_keeps_its_own(make_rig: MakeRig) -> None:
    rig = make_rig(pictures=50)
    rig.see(1.0)
    for _ in range(30):
        rig.daemon.live_picture.want()
        rig.see(0.1, "drum")
    assert rig.calls.call is not None
    assert shown(rig).jpeg.startswith(b"\xff\xd8")
    rig.writer.drain()
    assert len(list((rig.folder / "pictures").glob("*.jpg"))) == len([one for one in draws(rig) if one.store])
    assert (rig.folder / "calls" / f"{rig.calls.call.id}.jpg").exists()


def test_a_vision_that_dies_over_a_picture_draws_the_next_one(rig: Rig) -> None:
    rig.see(1.0)
    rig.daemon.live_picture.want()
    rig.child.hung = True
    rig.see(0.3)
    rig.child.death = "SIGSEGV"
    rig.see(2.0)
    rig.daemon.live_picture.want()
    rig.see(1.0)
    assert shown(rig).frame > rig.frame_id - 12
