"""Rule 11: the same picture again is no fresh view while the vehicle moves, and all right while it stands."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.assessment import Reason
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.history import Place
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.preferences import Preferences
from companion.calls.holding import Vehicle
from companion.frozen import FrozenPicture
from companion.link.heard import Vehicle as Told
from companion.vision.messages import Looked, Situation
from companion.vision.worker import Worker
from companion.whereabouts import is_moving
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import AUTO, MANUAL, PERIOD, MakeRig, Rig, picture


def a_picture(value: int = 0) -> NDArray[np.uint8]:
    image = np.zeros((4, 6, 3), np.uint8)
    image[1, 2, 0] = value
    return image


def test_only_time_in_motion_without_any_change_counts() -> None:
    frozen = FrozenPicture()
    assert frozen.seconds(a_picture(), 1.0, moving=True) == 0.0
    assert frozen.seconds(a_picture(), 1.5, moving=True) == 0.5
    assert frozen.seconds(a_picture(), 5.0, moving=False) == 0.5
    assert frozen.seconds(a_picture(), 5.25, moving=True) == 0.75
    assert frozen.seconds(a_picture(1), 6.0, moving=True) == 0.0
    assert frozen.seconds(a_picture(1), 6.5, moving=True) == 0.5


def test_another_size_is_another_picture() -> None:
    frozen = FrozenPicture()
    frozen.seconds(a_picture(), 1.0, moving=True)
    assert frozen.seconds(np.zeros((4, 8, 3), np.uint8), 9.0, moving=True) == 0.0


@pytest.mark.parametrize(
    ("speed", "mode", "moving"),
    [
        (0.0, AUTO, False),
        (0.05, AUTO, False),
        (0.5, AUTO, True),
        (0.5, MANUAL, True),
        (None, AUTO, True),
        (None, MANUAL, False),
    ],
)
def test_what_moves_is_what_has_speed_or_else_drives_itself(
    make_rig: MakeRig, speed: float | None, mode: int, moving: bool
) -> None:
    rig = make_rig()
    told = Told(1, 10, mode, armed=True, heard_at=0.0, speed=speed)
    seen = Vehicle(mode, True, None, 0.0, rig.calls.autopilot.autopilot)  # noqa: FBT003
    calls = SimpleNamespace(autopilot=seen)
    assert is_moving(SimpleNamespace(vehicle=told), calls) is moving  # type: ignore[arg-type]


def test_without_a_vehicle_nothing_moves(make_rig: MakeRig) -> None:
    calls = SimpleNamespace(autopilot=make_rig().calls.autopilot.__class__())
    assert not is_moving(SimpleNamespace(vehicle=None), calls)  # type: ignore[arg-type]


class Clock:
    """Monotonic time that passes when told to."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_the_worker_says_so_after_t_and_until_the_picture_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr("companion.vision.worker.time.monotonic", clock)
    perceiver = Painted()
    memory = first_memory(perceiver.model_id, Preferences.parse("grass: 1; rock: -1"))
    engine = AnyTraverse(perceiver, Settings(freshness=1.0), memory)
    worker = Worker(engine, 1)
    worker.handle(Situation(Place(), moving=True))

    def look(seconds: float, thing: str = "") -> Looked:
        clock.now += seconds
        return worker.look(Frame(1, clock.now, picture(thing)))

    def frozen(looked: Looked) -> bool:
        finding = looked.assessment.finding(Reason.FAULT)
        return finding is not None and finding.figure == "camera frozen"

    assert not any(frozen(look(0.25)) for _ in range(5))
    assert frozen(look(0.25))
    worker.handle(Situation(Place(), moving=False))
    assert frozen(look(10.0)), "stopped for it, it is no better"
    worker.handle(Situation(Place(), moving=True))
    assert not frozen(look(0.25, "rock"))


def freeze(rig: Rig, image: NDArray[np.uint8], seconds: float) -> None:
    """A camera that delivers `image` ten times a second, each as if just taken."""
    for _ in range(round(seconds / PERIOD)):
        rig.frame_id += 1
        rig.step(Frame(rig.frame_id, rig.clock.now + PERIOD - 0.02, image))


def test_a_vehicle_that_may_be_held_is_held_for_a_frozen_camera(make_rig: MakeRig) -> None:
    rig = make_rig()
    assert rig.state == ("OK", 0)
    same = picture()
    freeze(rig, same, 1.0)
    assert rig.state == ("OK", 0)
    freeze(rig, same, 1.0)
    assert rig.stage.mode == 4
    assert rig.state == ("FAULT", 1)
    assert any("camera frozen" in text for text in rig.texts)
    freeze(rig, same, 3.0)
    assert rig.state == ("FAULT", 1)
    rig.see(1.0, ground="rock")
    assert rig.state[0] != "FAULT"
