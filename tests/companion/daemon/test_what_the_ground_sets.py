"""Region of interest, rates, budget, words by text, answers by parameter; what of it outlives a restart."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink
from pymavlink.mavftp import MAVFTP

from anytraverse.memory import first_memory
from anytraverse.regions import Box
from companion.config import Config
from companion.config.schema import MountSection, StoppingSection
from companion.daemon.composition import restore_settings
from companion.daemon.trial_call import REQUEST
from companion.sim.loopback_link import FileClient
from companion.vision.memory_copy import update_from
from companion.vision.messages import Model, Ready
from companion.vision.warm_up import judging_settings
from companion.wire import parameters
from companion.wire.ids import Motion, Policy
from companion.wire.parameters import NOT_IN_USE, ROI, Parameter, ParameterError
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import AUTO, HOLD, WORDS, MakeRig, Rig

LEFT, TOP, RIGHT, BOTTOM = ROI.values()


def region(rig: Rig) -> tuple[float, ...]:
    box = rig.engine.settings.region.bounds
    assert box == rig.calls.numbers.judging.region.bounds
    return tuple(round(side, 4) for side in (box.left, box.top, box.right, box.bottom))


def set_words(rig: Rig, text: str, name: str = "AT_WORDS") -> None:
    rig.stage.send(mavlink.MAVLink_param_ext_set_message(1, 191, name.encode(), text.encode(), 11))


def results(rig: Rig) -> list[tuple[str, int]]:
    return [(m.param_id, m.param_result) for m in rig.stage.sent("PARAM_EXT_ACK")]


def command(rig: Rig, number: int, *values: float) -> None:
    rig.stage.send(
        mavlink.MAVLink_command_long_message(1, 191, number, 0, *values, *[0.0] * (7 - len(values)))
    )


def outrunning(config: Any) -> Any:
    """A vehicle that just stops before what the rig's region of interest shows."""
    return replace(
        config,
        mount=MountSection(height=1.0, tilt=10.0),
        stopping=StoppingSection(speed=1.0, time_constant=0.1, braking=1.0),
    )


def test_the_parameter_file_tells_what_was_set_beside_what_is_configured(rig: Rig) -> None:
    rig.set("AT_THR_ROI", 0.4)
    rig.set("AT_W_ROCK", -0.5)
    rig.see(0.5)
    client = FileClient(rig.stage)
    client.open("@PARAM/param.pck?withdefaults=1")
    packed = b"".join(client.read(offset=at, size=239).data for at in range(0, 400, 239))
    found = MAVFTP.ftp_param_decode(packed)
    both = [
        (now[0].decode(), before[1], now[1]) for before, now in zip(found.defaults, found.params, strict=True)
    ]
    changed = [(name, round(before, 4), round(now, 4)) for name, before, now in both if before != now]
    assert changed == [("AT_THR_ROI", 0.3, 0.4), ("AT_W_ROCK", -1.0, -0.5)]


def test_the_region_of_interest_reaches_eyes_and_state_machine(rig: Rig) -> None:
    rig.set(LEFT, 0.2)
    rig.set(BOTTOM, 0.9)
    rig.see(0.5)
    assert region(rig) == (0.2, 0.6, 0.6667, 0.9)
    assert (rig.echoes(LEFT), rig.echoes(BOTTOM)) == ([0.2], [0.9])


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        (LEFT, 0.7, "Refused: ROI left must be < right"),
        (RIGHT, 0.3, "Refused: ROI left must be < right"),
        (RIGHT, 0.37, "Refused: ROI left to right under 0.05"),
        (TOP, 0.95, "Refused: ROI top must be < bottom"),
        (BOTTOM, 0.62, "Refused: ROI top to bottom under 0.05"),
        (LEFT, 0.5, "Refused: ROI 0.16 wide, vehicle 0.30: widen it"),
    ],
)
def test_a_region_that_makes_no_sense_is_refused_with_the_old_value(
    rig: Rig, name: str, value: float, text: str
) -> None:
    before = region(rig)
    rig.set(name, value)
    rig.see(0.5)
    assert region(rig) == before
    assert rig.echoes(name) == [round(dict(zip(ROI.values(), before, strict=True))[name], 4)]
    assert text in rig.texts


def test_a_region_moves_by_setting_the_side_first_that_it_moves_towards(rig: Rig) -> None:
    rig.set(RIGHT, 0.95)
    rig.set(LEFT, 0.6)
    rig.see(0.5)
    assert region(rig) == (0.6, 0.6, 0.95, 0.95)


@pytest.mark.slow
def test_what_the_ground_set_outlives_a_restart(rig: Rig) -> None:
    for name, value in {"AT_THR_TRAV": 0.25, TOP: 0.5, "AT_SUM_HZ": 0.25, "AT_BUDGET": 120.0}.items():
        rig.set(name, value)
    rig.see(1.0)
    rig.restart()
    rig.see(21.0)
    assert rig.left_out == []
    assert region(rig)[1] == 0.5
    assert rig.calls.numbers.judging.thresholds.trav == 0.25
    for name, value in {"AT_THR_TRAV": 0.25, TOP: 0.5, "AT_SUM_HZ": 0.25, "AT_BUDGET": 120.0}.items():
        assert rig.echoes(name) == [value]
    assert len(rig.stage.sent("TUNNEL")) <= 7
    assert set(rig.daemon.status.figures()["set_by_ground"]) == {"AT_THR_TRAV", TOP, "AT_SUM_HZ", "AT_BUDGET"}


def test_a_value_edited_in_the_file_since_wins_and_that_is_told(rig: Rig) -> None:
    rig.set(TOP, 0.5)
    rig.set(BOTTOM, 0.9)
    rig.see(0.5)
    rig.roi = (1 / 3, 0.55, 2 / 3, 0.95)
    rig.restart()
    rig.see(0.5)
    assert region(rig) == (0.3333, 0.55, 0.6667, 0.9)
    assert rig.left_out == [f"{TOP}: edited in the file, which wins"]


def test_set_back_to_what_is_configured_it_is_forgotten(rig: Rig) -> None:
    rig.set(TOP, 0.5)
    rig.see(0.3)
    rig.set(TOP, 0.6)
    rig.see(0.3)
    assert rig.daemon.status.figures()["set_by_ground"] == {}


def test_a_reset_makes_settings_and_words_as_configured_and_is_then_acknowledged(rig: Rig) -> None:
    rig.set(TOP, 0.5)
    rig.set("AT_SUM_HZ", 0.0)
    rig.set("AT_W_GRASS", -1.0)
    set_words(rig, "drum: 0.5")
    rig.see(1.0)
    command(rig, mavlink.MAV_CMD_PREFLIGHT_STORAGE, 2)
    rig.see(1.0)
    assert [ack.result for ack in rig.stage.sent("COMMAND_ACK")] == [mavlink.MAV_RESULT_ACCEPTED]
    assert region(rig)[1] == 0.6
    assert rig.vision.words.format() == "grass: 1; rock: -1"
    assert (rig.echoes(TOP)[-1], rig.echoes("AT_SUM_HZ")[-1], rig.echoes("AT_W_DRUM")[-1]) == (0.6, 1.0, -2.0)
    assert rig.daemon.status.figures()["set_by_ground"] == {}


def test_hold_keeps_what_would_let_the_vehicle_outrun_its_eyes(make_rig: MakeRig) -> None:
    rig = make_rig(Policy.HOLD)
    rig.config = outrunning(rig.config)
    rig.restart()
    rig.see(1.0)
    assert rig.daemon.status.figures()["hold_refused"] == ""
    rig.set(TOP, 0.85)
    rig.see(1.5)
    assert rig.echoes(TOP)[-1] == 0.6
    assert rig.texts[-1].startswith(f"{TOP} kept: 1.0 m/s outruns eyes, 0.")
    told = [rig.told_policy]
    rig.set("AT_POLICY", float(Policy.REPORT))
    rig.see(0.3)
    rig.set(TOP, 0.85)
    rig.see(1.5)
    assert rig.echoes(TOP)[-1] == 0.85
    rig.set("AT_POLICY", float(Policy.HOLD))
    rig.see(1.5)
    assert [*told, rig.told_policy] == [Policy.HOLD, Policy.REPORT]
    assert any(text.startswith("HOLD refused: 1.0 m/s outruns eyes") for text in rig.texts)


def test_words_by_text_may_be_outside_the_vocabulary_and_outlive_a_restart(rig: Rig) -> None:
    set_words(rig, "kind 3: -1; grass: 0.5")
    rig.see(0.5)
    assert results(rig) == [("AT_WORDS", mavlink.PARAM_ACK_ACCEPTED)]
    assert rig.echoes("AT_W_GRASS") == [0.5]
    rig.restart()
    rig.see(0.5)
    rig.stage.send(mavlink.MAVLink_param_ext_request_read_message(1, 191, b"AT_WORDS", -1))
    rig.see(0.5)
    assert rig.stage.sent("PARAM_EXT_VALUE")[0].param_value == "grass: 0.5; rock: -1; kind 3: -1"


def test_words_by_text_that_the_perceiver_cannot_ground_fail_all_of_them(rig: Rig) -> None:
    set_words(rig, "kind 3: -1; unicorn: 1")
    rig.see(0.5)
    assert results(rig) == [("AT_WORDS", mavlink.PARAM_ACK_FAILED)]
    assert any(text.startswith("Refused: ") and "unicorn" in text for text in rig.texts)
    assert rig.vision.words.format() == "grass: 1; rock: -1"


def test_a_call_is_answered_by_parameter_once(held: Rig) -> None:
    held.set("AT_ANSWER", 11)
    held.see(0.3, "drum")
    held.set("AT_ANSWER", 11)
    held.see(2.0, "drum")
    assert held.echoes("AT_ANSWER") == [11.0, 11.0]
    assert held.stage.mode == AUTO
    held.set("AT_ANSWER", 92)
    held.see(0.5)
    assert held.echoes("AT_ANSWER")[-1] == 0.0
    assert "No open call or hold 9: nothing changed" in held.texts


def test_stay_by_parameter_to_the_current_one(held: Rig) -> None:
    held.set("AT_ANSWER", float(Motion.STAY))
    held.see(1.0, "drum")
    assert held.echoes("AT_ANSWER") == [2.0]
    assert held.stage.mode == HOLD
    assert held.calls.call is not None
    assert held.calls.call.quiet


def test_a_start_takes_up_what_was_set_and_tells_what_it_left_out(
    caplog: pytest.LogCaptureFixture,
) -> None:
    config, perceiver, news = Config(), Painted(), list[str]()
    memory = first_memory("painted-1", WORDS)
    settings = judging_settings(config, perceiver)
    ready = Ready(Model.of(perceiver), settings, update_from(None, memory, 1, 0, ()), (), 0.02)
    values = {TOP: [0.5, 0.6], LEFT: [0.2, 0.3], "AT_SUM_HZ": [2.0, 1.0]}
    saved = {"model": perceiver.model_id, "values": values}
    overrides, judging = restore_settings(config, ready, saved, news)
    assert judging.region.bounds == Box(0.333, 0.5, 0.667, 0.95)
    assert overrides.values == {TOP: 0.5, "AT_SUM_HZ": 2.0}
    assert news == [f"{LEFT}: edited in the file, which wins"]
    assert "set by the ground, not as in the file" in caplog.text


def test_a_parameter_that_could_be_set_but_not_stored_is_refused_at_the_start(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    more = (*parameters._MORE, Parameter("AT_NEW", 0.5, 0.0, 1.0))
    monkeypatch.setattr(parameters, "_MORE", more)
    with pytest.raises(ParameterError, match="AT_NEW cannot be stored: add to storable_defaults"):
        make_rig()


def test_a_test_call_is_answered_by_parameter_too(rig: Rig) -> None:
    (rig.folder / REQUEST).touch()
    rig.see(3.0)
    assert rig.state == ("OK", 1)
    rig.set("AT_ANSWER", 11)
    rig.see(0.5)
    assert rig.echoes("AT_ANSWER") == [11.0]
    assert rig.state == ("OK", 0)


def test_a_budget_beyond_a_serial_line_is_refused_and_one_kept_from_another_line_is_dropped(rig: Rig) -> None:
    rig.set("AT_BUDGET", 400)
    rig.see(0.3)
    rig.restart()
    rig.stage.link.most_budget = 320.0  # as for 9600 baud, of which asked_budget takes 160 B/s
    rig.settings.start(rig.clock.now)
    rig.see(0.3)
    assert rig.settings.overrides.values == {}
    assert rig.echoes("AT_BUDGET")[-1] == 300
    for value in (330, 0, 310):
        rig.set("AT_BUDGET", value)
        rig.see(0.5)
    assert rig.echoes("AT_BUDGET")[-3:] == [300, 300, 310]
    assert "AT_BUDGET takes up to 320: kept" in rig.texts


def test_a_weight_that_was_told_before_the_perceiver_was_loaded_and_is_not_in_force_is_told_anew(
    rig: Rig,
) -> None:
    rig.stage.link.parameters.set_value("AT_W_DRUM", -0.5, rig.clock.now)
    rig.settings.start(rig.clock.now)
    rig.see(1.0)
    assert rig.echoes("AT_W_DRUM")[-1] == NOT_IN_USE
