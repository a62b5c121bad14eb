"""A vehicle that drives faster than configured: the region reaches further, or hold cannot be given."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.errors import SettingsError
from companion.config import Config
from companion.config.schema import MountSection, StoppingSection
from companion.config.stopping import Stopping, ground_region, judge_stopping, with_settings
from companion.daemon.policy import hold_gate
from companion.wire.ids import Motion
from tests.anytraverse.conftest import HEIGHT, WIDTH
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig


@pytest.fixture
def driving(make_rig: MakeRig) -> Rig:
    rig = make_rig()
    rig.config = replace(
        Config(),
        mount=MountSection(height=1.0, tilt=10.0, front=0.3, width=0.6, aspect=WIDTH / HEIGHT),
        stopping=StoppingSection(speed=0.8, time_constant=0.1, braking=4.0),
    )
    rig.restart()
    drive(rig, 2.0, 0.8)
    return rig


def drive(rig: Rig, seconds: float, speed: float, thing: str = "") -> None:
    """Frames and positions come at this speed."""
    for _ in range(round(seconds / 0.5)):
        north = round(100 * speed)
        rig.stage.send(mavlink.MAVLink_global_position_int_message(0, 1, 1, 0, 0, north, 0, 0, 0), (1, 1))
        rig.see(0.5, thing)


def reach(rig: Rig) -> float | None:
    """How far ahead the newest frame was judged, m; None: as configured."""
    newest = rig.calls.reason_filter.newest
    assert newest is not None
    return newest.frame.reach


@pytest.mark.slow
def test_the_region_follows_the_speed_and_falls_back_later(driving: Rig) -> None:
    configured = ground_region(driving._config())
    assert configured is not None
    assert reach(driving) is None
    drive(driving, 3.0, 1.2)
    further = reach(driving)
    assert further is not None
    assert configured.far < further < 6.0
    drive(driving, 4.0, 0.8)
    assert reach(driving) == further
    drive(driving, 3.0, 0.8)
    assert reach(driving) is None
    assert driving.state == ("OK", 0)


@pytest.mark.slow
def test_it_does_not_become_shorter_while_something_is_asked_or_accepted(driving: Rig) -> None:
    drive(driving, 3.0, 1.2)
    further = reach(driving)
    drive(driving, 2.0, 1.2, "drum")
    call = driving.calls.current_id
    assert call
    drive(driving, 8.0, 0.0, "drum")
    assert reach(driving) == further
    driving.answer(call, Motion.GO)
    drive(driving, 8.0, 0.8, "drum")
    assert driving.calls.reason_filter.things, "the drum is accepted, and in view"
    assert reach(driving) == further
    drive(driving, 8.0, 0.8)
    assert reach(driving) is None


def test_it_becomes_longer_while_a_call_is_open(driving: Rig) -> None:
    drive(driving, 1.0, 0.8, "drum")
    assert driving.calls.current_id
    assert reach(driving) is None
    drive(driving, 2.0, 1.2, "drum")
    assert reach(driving) is not None


@pytest.mark.slow
def test_a_speed_at_which_it_cannot_stop_in_time_is_a_fault_until_it_stands(driving: Rig) -> None:
    drive(driving, 3.0, 6.0)
    assert driving.state[0] == "FAULT"
    assert driving.stage.mode == HOLD
    assert any(text.startswith("FAULT: 5.") and "at most" in text for text in driving.texts), driving.texts
    drive(driving, 8.0, 0.0)
    assert driving.state[0] != "FAULT"
    driving.answer(driving.calls.current_id, Motion.GO)
    drive(driving, 3.0, 0.8)
    assert driving.stage.mode == AUTO


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.9, 1.1, 2.5])
def test_one_wrong_report_of_the_speed_holds_nobody(driving: Rig, gap: float) -> None:
    drive(driving, 0.5, 6.0)
    driving.see(gap)
    drive(driving, 3.0, 0.8)
    assert driving.state == ("OK", 0)
    assert driving.stage.mode == AUTO


@pytest.mark.slow
def test_where_the_speed_is_lost_the_region_stays_as_long_as_it_was(driving: Rig) -> None:
    drive(driving, 3.0, 1.2)
    further = reach(driving)
    driving.see(10.0)
    assert reach(driving) == further is not None


@pytest.mark.slow
def test_how_fast_a_human_drives_counts_for_nothing(driving: Rig) -> None:
    driving.stage.mode = MANUAL
    drive(driving, 5.0, 6.0)
    assert driving.state == ("OK", 0)
    driving.stage.mode = AUTO
    drive(driving, 2.0, 0.8)
    assert (driving.state, driving.stage.mode) == (("OK", 0), AUTO)


@pytest.mark.slow
def test_a_speed_that_only_the_longer_region_allows_is_allowed(driving: Rig) -> None:
    driving.stage.mode = AUTO
    drive(driving, 4.0, 1.6)
    assert driving.state == ("OK", 0)
    config, judging = driving._config(), driving.calls.numbers.judging
    fixed = with_settings(config, judging)
    alone = judge_stopping(fixed, driving.step_time, judging.thresholds.tile, 1.5)
    assert isinstance(alone, Stopping)
    assert not alone.enough, "the configured region is too short for it"


@pytest.mark.slow
def test_a_camera_that_looks_aside_keeps_its_region(driving: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def too_little(*_: object) -> None:
        raise SettingsError("the camera looks aside")

    monkeypatch.setattr(hold_gate, "ground_region", too_little)
    drive(driving, 3.0, 1.2)
    assert reach(driving) is None


@pytest.mark.slow
def test_sides_that_the_ground_set_stay_where_they_are(driving: Rig) -> None:
    driving.set("AT_ROI_T", 0.4)
    drive(driving, 3.0, 1.2)
    assert driving.calls.numbers.judging.metres is None
    assert reach(driving) is None
    region = driving.calls.numbers.judging.region
    newest = driving.calls.reason_filter.newest
    assert newest is not None
    assert driving.calls.numbers.at(newest).judging.region == region
