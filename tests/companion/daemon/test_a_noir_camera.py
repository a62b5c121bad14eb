"""A camera that shows infrared: told by name, and handled or refused as perceiver and configuration say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from companion.config import Config
from companion.config.schema import CameraSection, MountSection, StoppingSection
from companion.vision import infrared
from companion.wire import notices
from companion.wire.ids import Policy
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import HOLD, MANUAL, MakeRig, Rig

SEEN = 10.0
"""Seconds within which a camera is recognised."""
GONE = 25.0
"""Seconds after which it is believed that it is another camera."""

Shows = Callable[[float], None]


@pytest.fixture
def shows(monkeypatch: pytest.MonkeyPatch) -> Shows:
    """Sets how much of the picture is magenta, at first all: painted pictures' colours are words.

    Pictures are looked at twice a second, so that less time need pass.
    """
    share = [1.0]
    monkeypatch.setattr(infrared, "magenta_share", lambda _: share[0])
    monkeypatch.setattr(infrared, "_EVERY", 0.5)

    def show(new: float) -> None:
        share[0] = new

    return show


def set_up(make_rig: MakeRig, camera: str = "auto", policy: Policy = Policy.HOLD) -> Rig:
    """A rover whose configuration says so of a NoIR camera."""
    rig = make_rig(policy)
    rig.config = replace(rig.config, camera=CameraSection(infrared=camera))
    rig.restart()
    return rig


@pytest.mark.slow
@pytest.mark.usefixtures("shows")
def test_hold_is_a_fault_by_name_with_a_perceiver_that_is_not_trained_for_it(
    make_rig: MakeRig, caplog: pytest.LogCaptureFixture
) -> None:
    rig = set_up(make_rig)
    assert rig.daemon.status.figures()["camera"]["infrared"] is None
    rig.see(SEEN)
    assert rig.told_policy is Policy.HOLD
    assert (rig.state[0], rig.stage.mode) == ("FAULT", HOLD)
    assert rig.texts.count(notices.infrared(handled=False)) == 1
    assert rig.texts.count("FAULT: NoIR camera: change it, or AT_POLICY 0") == 1
    assert rig.texts.count(f"H{rig.state[1]} FAULT NoIR camera") == 1
    assert "for which the perceiver is not trained" in caplog.text
    status = rig.daemon.status.figures()
    assert status["camera"]["infrared"] is True
    assert status["perceiver"]["infrared"] is False
    assert status["hold_refused"] == "HOLD refused: NoIR camera: change it"
    rig.see(5.0)
    rig.set("AT_POLICY", 2)
    rig.see(2.0)
    assert rig.told_policy is Policy.HOLD
    assert rig.texts.count("HOLD refused: NoIR camera: change it") == 1


@pytest.mark.slow
@pytest.mark.usefixtures("shows")
def test_what_to_do_is_repeated_while_nothing_is_held(make_rig: MakeRig) -> None:
    rig = set_up(make_rig)
    rig.stage.mode = MANUAL
    rig.see(80.0)
    assert rig.texts.count("FAULT: NoIR camera: change it, or AT_POLICY 0") > 1


@pytest.mark.slow
@pytest.mark.usefixtures("shows")
@pytest.mark.parametrize(("camera", "trained"), [("handle", False), ("auto", True), ("handle", True)])
def test_it_is_handled_where_perceiver_or_configuration_say_so(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, camera: str, trained: bool
) -> None:
    monkeypatch.setattr(Painted, "infrared", trained, raising=False)
    rig = set_up(make_rig, camera)
    rig.see(SEEN)
    assert rig.told_policy is Policy.HOLD
    assert rig.texts.count("Camera shows infrared (NoIR): handled") == 1
    status = rig.daemon.status.figures()
    assert (status["camera"]["infrared"], status["hold_refused"]) == (True, "")
    assert status["perceiver"]["infrared"] is trained


@pytest.mark.usefixtures("shows")
def test_an_owner_may_refuse_it_for_a_perceiver_that_is_trained(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Painted, "infrared", True, raising=False)
    rig = set_up(make_rig, "refuse")
    rig.see(SEEN)
    assert rig.state[0] == "FAULT"


@pytest.mark.usefixtures("shows")
def test_it_is_a_fault_too_before_an_autopilot_is_heard(make_rig: MakeRig) -> None:
    rig = set_up(make_rig)
    rig.stage.vehicle = None
    rig.restart()
    rig.stage.vehicle = None
    rig.see(SEEN)
    assert rig.stage.link.vehicle is None
    assert rig.told_policy is Policy.HOLD
    assert rig.state == ("FAULT", 0)
    assert rig.texts.count("FAULT: NoIR camera: change it, or AT_POLICY 0") == 1


@pytest.mark.slow
def test_one_that_shows_none_is_never_told_of(make_rig: MakeRig, shows: Shows) -> None:
    shows(0.0)
    rig = set_up(make_rig)
    rig.see(GONE)
    assert rig.told_policy is Policy.HOLD
    assert not [text for text in rig.texts if "infrared" in text]
    assert rig.daemon.status.figures()["camera"]["infrared"] is False


@pytest.mark.slow
def test_another_camera_is_told_of_once_and_ends_the_fault(make_rig: MakeRig, shows: Shows) -> None:
    rig = set_up(make_rig)
    rig.see(SEEN)
    shows(0.0)
    told = [rig.state[0]]
    rig.see(GONE)
    assert rig.texts.count("Camera shows no infrared any more") == 1
    assert [*told, rig.state[0]] == ["FAULT", "HOLDING"]
    assert rig.told_policy is Policy.HOLD
    assert rig.stage.mode == HOLD, "nothing resumes by itself"
    assert rig.texts.count(notices.infrared(handled=False)) == 1


@pytest.mark.slow
def test_pictures_that_look_so_now_and_then_change_nothing(make_rig: MakeRig, shows: Shows) -> None:
    rig = set_up(make_rig)
    rig.see(SEEN)
    for number in range(40):
        shows(float(number % 4 == 0))
        rig.see(0.5)
    assert [text for text in rig.texts if "nfrared" in text] == [notices.infrared(handled=False)]
    assert rig.texts.count("FAULT: NoIR camera: change it, or AT_POLICY 0") == 1
    assert rig.daemon.status.figures()["camera"]["infrared"] is True


@pytest.mark.slow
@pytest.mark.usefixtures("shows")
def test_a_new_vision_process_does_not_forget_it(make_rig: MakeRig, shows: Shows) -> None:
    rig = set_up(make_rig)
    rig.see(SEEN)
    shows(0.0)
    rig.hung = True
    rig.see(5.0)
    rig.hung = False
    rig.see(10.0)
    assert rig.daemon.status.figures()["vision"]["restarts"] == 1
    assert rig.daemon.status.figures()["camera"]["infrared"] is True
    assert rig.daemon.status.figures()["hold_refused"] == "HOLD refused: NoIR camera: change it"


@pytest.mark.slow
@pytest.mark.usefixtures("shows")
def test_a_vehicle_that_outruns_its_eyes_is_told_that_first(make_rig: MakeRig) -> None:
    rig = set_up(make_rig)
    rig.config = replace(
        Config(), mount=MountSection(height=1.0, tilt=10.0), stopping=StoppingSection(speed=9.0, braking=1.0)
    )
    rig.restart()
    rig.see(SEEN)
    assert rig.settings.policy.hold_refused.startswith("HOLD refused: 9.0 m/s outruns eyes")
