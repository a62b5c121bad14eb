"""The whole daemon with px4_deadman on the simulated PX4: what the end of its stream stops, and what not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import development as mavlink

from bench.virtual_time import Clock
from companion.config.schema import CallSection
from companion.sim.field.px4 import Px4Mode
from companion.wire.ids import ERROR, Motion, Policy
from tests.companion.daemon.rig import Rig
from tests.companion.daemon.test_a_px4_rover import STEP, Px4Rig

GUARDED = {
    "COM_RC_IN_MODE": 1,
    "COM_RC_LOSS_T": 0.5,
    "COM_FAIL_ACT_T": 0,
    "NAV_RCL_ACT": 1,
    "COM_OBL_RC_ACT": 5,
}
CONFIG = replace(Rig.config, call=CallSection(px4_deadman="manual_control"))
REFUSED = "Dead man OFF, sticks of 255/190: guard by hand"


class GuardedRig(Px4Rig):
    """A rig whose PX4 is set up for the stream, with its transmitter switched off."""

    def start(self, *, mode: int = 0, forget_frame: bool = False) -> None:
        self.rover.transmitter.on = False
        for name, value in GUARDED.items():
            self.px4.set_parameter(name, float(value))
        super().start(mode=mode, forget_frame=forget_frame)

    def dead(self, seconds: float) -> None:
        """The world goes on without the companion."""
        for _ in range(round(seconds / STEP)):
            self.clock.now += STEP
            self._stepped_at += STEP
            self.rover.step(STEP)
            self.px4.poll(self._stepped_at)

    @property
    def sticks(self) -> int:
        return len(self.stage.sent("MANUAL_CONTROL"))

    def streams(self) -> bool:
        before = self.sticks
        self.see(0.5)
        return self.sticks > before

    @property
    def told(self) -> tuple[str, str]:
        """What status.json and /state.json say of it."""
        return self.daemon.status.figures()["px4_deadman"], self.daemon.status.state_file()["px4_deadman"]


@pytest.fixture(params=["loiter", "offboard"])
def rig(tmp_path: Path, clock: Clock, request: pytest.FixtureRequest) -> Iterator[GuardedRig]:
    """It drives in MISSION, and the stream is on."""
    rig = GuardedRig(tmp_path, clock, request.param, CONFIG)
    rig.see(5.0)
    assert rig.rover.speed > 2.0
    assert rig.told == ("on", "on")
    yield rig
    rig.kill()


@pytest.mark.slow
def test_killed_in_a_mission_it_is_stopped_by_the_autopilot(rig: GuardedRig) -> None:
    rig.kill()
    killed = rig.rover.time
    rig.dead(20.0)
    assert rig.modes[-1] == ("LOITER", "autopilot")
    assert rig.px4.mode_log[-1].t - killed < 0.7
    assert rig.rover.speed == 0.0
    rig.start()
    rig.see(10.0)
    assert rig.px4.mode.name == "LOITER", "nothing resumes by itself"
    assert not rig.streams()
    rig.px4.set_mode(Px4Mode.MISSION, "hand")
    rig.see(2.0)
    assert rig.streams()
    assert rig.px4.mode.name == "MISSION"


@pytest.mark.slow
def test_it_is_held_and_goes_on_after_a_go_with_no_gap_in_the_stream(rig: GuardedRig) -> None:
    rig.see(10.0, "drum")
    assert rig.rover.speed == 0.0
    assert rig.streams()
    rig.word(1, "drum", 1.0, Motion.GO)
    rig.see(4.0, "drum")
    by = [who for _, who in rig.modes]
    assert by == ["hand", "companion", "companion"]
    assert rig.px4.mode.name == "MISSION"
    assert not any("Dead man" in text for text in rig.texts)


@pytest.mark.slow
def test_killed_in_its_own_hold_it_stays_standing(rig: GuardedRig) -> None:
    rig.see(10.0, "drum")
    rig.kill()
    rig.dead(10.0)
    assert rig.px4.mode.name == "LOITER"
    assert rig.rover.speed == 0.0
    rig.start()
    rig.see(1.0, "drum")


@pytest.mark.slow
@pytest.mark.parametrize("held", [False, True])
def test_a_human_s_mode_ends_the_stream(rig: GuardedRig, held: bool) -> None:
    if held:
        rig.see(10.0, "drum")
    rig.px4.set_mode(Px4Mode.POSITION, "hand")
    rig.see(1.5)
    assert not rig.streams()
    rig.see(1.0)
    assert rig.px4.mode.name == "LOITER", "without sticks PX4 leaves a mode of the sticks"
    assert rig.modes[-1][1] == "autopilot"
    assert rig.told == ("ready", "ready")
    assert not any("Dead man" in text for text in rig.texts)
    assert rig.calls.hold is None


@pytest.mark.slow
def test_a_lower_policy_ends_the_stream_and_says_that_px4_holds_then(rig: GuardedRig) -> None:
    rig.set("AT_POLICY", float(Policy.REPORT))
    rig.see(3.0)
    assert not rig.streams()
    assert "Dead man ends: PX4 holds, set MISSION by hand" in rig.texts
    assert rig.px4.mode.name == "LOITER"
    rig.px4.set_mode(Px4Mode.MISSION, "hand")
    rig.see(5.0)
    assert rig.px4.mode.name == "MISSION"
    assert not rig.streams()


@pytest.mark.slow
def test_ended_in_good_order_in_a_mission_it_is_stopped_too(rig: GuardedRig) -> None:
    rig.leave()
    rig.kill()
    rig.dead(10.0)
    assert rig.modes[-1] == ("LOITER", "autopilot")
    rig.start()
    rig.see(1.0)


@pytest.mark.slow
def test_somebody_else_s_sticks_end_it_for_good_and_that_is_repeated(rig: GuardedRig) -> None:
    rig.stage.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0), (255, 190))
    rig.see(1.0)
    first = next(message for message in rig.stage.sent("STATUSTEXT") if message.text == REFUSED)
    assert first.severity == ERROR
    assert rig.told == ("refused", "refused")
    assert not rig.streams()
    assert rig.px4.mode.name == "LOITER"
    rig.px4.set_mode(Px4Mode.MISSION, "hand")
    rig.see(130.0)
    assert not rig.streams()
    assert rig.texts.count(REFUSED) >= 3
    rig.restart()
    rig.see(5.0)
    assert rig.told[0] in ("on", "ready")


@pytest.mark.slow
def test_a_transmitter_that_is_switched_on_ends_it_for_good(rig: GuardedRig) -> None:
    rig.rover.transmitter.on = True
    rig.see(2.0)
    assert "Dead man OFF, sticks of transmitter: guard by hand" in rig.texts
    assert rig.told == ("refused", "refused")


@pytest.mark.slow
def test_as_shipped_no_sticks_are_sent(tmp_path: Path, clock: Clock) -> None:
    rig = Px4Rig(tmp_path, clock, "loiter", Rig.config)
    rig.see(8.0)
    assert rig.stage.sent("MANUAL_CONTROL") == []
    assert rig.daemon.status.figures()["px4_deadman"] == "off"
    rig.kill()
