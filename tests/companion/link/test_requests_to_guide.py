"""The request for GUIDED leaves after the heartbeat that says what it is for."""

from __future__ import annotations

from companion.config.link_settings import LinkSettings
from companion.sim.loopback_link import LoopbackLink
from companion.wire.ids import INFO, MODE_REQUEST_COMMAND, Policy, State, read_heartbeat_mode
from tests.companion.link.test_mode_commands import ACCEPTED, CHANGED, answer, sent

AUTO, GUIDED = 10, 15


def test_it_does_so_also_where_texts_have_spent_the_budget() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", budget=100.0, burst=300.0))
    stage.run(0.2)
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, int(sent(stage, MODE_REQUEST_COMMAND)[-1].param4))
    for number in range(20):
        stage.link.texts.send(f"notice {number}, as long as a text can be, or nearly", INFO, stage.now)
    stage.run(2.0)
    told = len(stage.sent("STATUSTEXT"))
    for _ in range(200):
        if len(stage.sent("STATUSTEXT")) > told:
            break
        stage.run(0.01)
    before = len(stage.frames)
    stage.link.set_state(State.OK, 0, Policy.GUIDE, guiding=True)
    stage.run(0.01)
    stage.link.modes.guide(GUIDED, AUTO, stage.now)
    stage.run(0.5)
    left = [frame.message for frame in stage.frames[before:]]
    beats = [one.get_type() == "HEARTBEAT" and read_heartbeat_mode(one.custom_mode).guiding for one in left]
    requests = [one.get_type() == "COMMAND_LONG" and one.param3 == GUIDED for one in left]
    assert beats.index(True) < requests.index(True)


def test_the_mode_that_the_script_has_set_and_read_back_is_known_before_the_next_heartbeat() -> None:
    stage = LoopbackLink()
    stage.mode = GUIDED
    stage.run(1.0)
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, int(sent(stage, MODE_REQUEST_COMMAND)[-1].param4))
    stage.run(0.02)
    for result, mode in ((CHANGED, GUIDED), (ACCEPTED, AUTO)):
        stage.link.modes.guide(AUTO, GUIDED, stage.now)
        stage.run(0.02)
        answer(stage, MODE_REQUEST_COMMAND, result, int(sent(stage, MODE_REQUEST_COMMAND)[-1].param4))
        stage.run(0.02)
        assert stage.link.vehicle is not None
        assert stage.link.vehicle.custom_mode == mode
