"""The tables of the autopilots' parameters: which values make a hold unsafe, and for whom."""

from __future__ import annotations

import pytest

from companion.desk.check.interview import ARDUPILOT, PX4, Facts, judge, names, speed
from companion.desk.check.rules import Verdict

GOOD = {
    "MIS_RESTART": 0.0,
    "SCR_ENABLE": 1.0,
    "SCR_HEAP_SIZE": 122880.0,
    "SCR_VM_I_COUNT": 10000.0,
    "ATS_ENABLE": 1.0,
    "ATS_MODES": 33792.0,
    "FS_ACTION": 2.0,
    "FS_THR_ENABLE": 1.0,
    "SYSID_MYGCS": 255.0,
    "AVOID_ENABLE": 3.0,
    "AVOID_BACKUP_SPD": 0.0,
    "PRX1_TYPE": 2.0,
}
GOOD_PX4 = {
    "MAV_0_FORWARD": 1.0,
    "MAV_1_FORWARD": 1.0,
    "COM_OBL_RC_ACT": 5.0,
    "COM_OF_LOSS_T": 1.0,
    "NAV_RCL_ACT": 1.0,
    "NAV_DLL_ACT": 0.0,
}
GUARDED = {
    **GOOD_PX4,
    "COM_RC_IN_MODE": 1.0,
    "COM_RC_LOSS_T": 0.5,
    "COM_FAIL_ACT_T": 0.0,
    "COM_RCL_EXCEPT": 0.0,
}
"""A PX4 that stops when the stream of px4_deadman ends."""


def test_good_parameters_raise_nothing() -> None:
    assert judge(ARDUPILOT, Facts(GOOD), holds=True) == []
    assert judge(PX4, Facts(GOOD_PX4, offboard=True), holds=True) == []


@pytest.mark.parametrize(
    ("autopilot", "name", "value", "verdict", "told"),
    [
        (ARDUPILOT, "MIS_RESTART", 1, Verdict.FAIL, "the mission starts over: set 0"),
        (ARDUPILOT, "SCR_ENABLE", 0, Verdict.FAIL, "nothing stops the vehicle when the companion dies"),
        (ARDUPILOT, "ATS_ENABLE", 0, Verdict.FAIL, "switched off"),
        (ARDUPILOT, "ATS_MODES", 32768, Verdict.FAIL, "does not guard all modes that drive"),
        (ARDUPILOT, "ATS_MODES", 1024, Verdict.FAIL, "set 33792"),
        (ARDUPILOT, "ATS_RC", 300, Verdict.WARN, "no RCn_OPTION is that number"),
        (ARDUPILOT, "SCR_HEAP_SIZE", 65536, Verdict.WARN, "122880"),
        (ARDUPILOT, "SCR_VM_I_COUNT", 1000, Verdict.WARN, "10000"),
        (ARDUPILOT, "FS_ACTION", 0, Verdict.WARN, "does nothing"),
        (ARDUPILOT, "FS_ACTION", 1, Verdict.WARN, "drives the vehicle home"),
        (ARDUPILOT, "FS_THR_ENABLE", 0, Verdict.WARN, "transmitter"),
        (ARDUPILOT, "FS_THR_ENABLE", 2, Verdict.WARN, "in AUTO it drives on without the pilot's"),
        (ARDUPILOT, "SYSID_MYGCS", 1, Verdict.FAIL, "passes for the ground station"),
        (ARDUPILOT, "MAV_GCS_SYSID", 1, Verdict.FAIL, "passes for the ground station"),
        (ARDUPILOT, "SYSID_MYGCS", 77, Verdict.WARN, "allowed_senders"),
        (ARDUPILOT, "AVOID_BACKUP_SPD", 0.75, Verdict.WARN, "backs up"),
        (ARDUPILOT, "ATS_TIMEOUT", 5, Verdict.WARN, "set 1.5"),
        (ARDUPILOT, "ATS_FAULT", 0, Verdict.WARN, "set 1"),
        (ARDUPILOT, "FLTMODE_GCSBLOCK", 129, Verdict.WARN, "subtract 128"),
        (ARDUPILOT, "SERIAL2_OPTIONS", 1032, Verdict.WARN, "subtract 1024"),
        (ARDUPILOT, "MAV3_OPTIONS", 3, Verdict.WARN, "subtract 2"),
        (PX4, "MAV_2_FORWARD", 0, Verdict.WARN, "set 1"),
        (PX4, "MAV_1_FORWARD", 0, Verdict.WARN, "do not hear each other"),
        (PX4, "COM_OBL_RC_ACT", 3, Verdict.WARN, "drives the vehicle home"),
        (PX4, "COM_OF_LOSS_T", 5, Verdict.WARN, "noticed late"),
        (PX4, "NAV_RCL_ACT", 2, Verdict.WARN, "transmitter"),
        (PX4, "NAV_DLL_ACT", 2, Verdict.WARN, "ground station"),
    ],
)
def test_one_bad_value_is_one_finding_with_what_to_do(
    autopilot: int, name: str, value: float, verdict: Verdict, told: str
) -> None:
    good = GOOD if autopilot == ARDUPILOT else GOOD_PX4
    (found,) = judge(autopilot, Facts({**good, name: float(value)}), holds=True)
    assert (found.check, found.verdict) == (f"{name} {value:g}", verdict)
    assert told in found.text


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [("OA_TYPE", 1, "plans round obstacles, too"), ("AVOID_ENABLE", 3, "stops for what its own sensor sees")],
)
def test_an_autopilot_that_avoids_by_itself_is_in_the_way_of_policy_guide_alone(
    name: str, value: float, told: str
) -> None:
    values = {**GOOD, "AVOID_ENABLE": 1.0, name: float(value)}
    for policy in ("report", "shadow", "hold"):
        assert judge(ARDUPILOT, Facts(values, policy=policy), holds=True) == []
    (found,) = judge(ARDUPILOT, Facts(values, policy="guide"), holds=True)
    assert (found.check, found.verdict) == (f"{name} {value:g}", Verdict.WARN)
    assert told in found.text


@pytest.mark.parametrize(
    ("name", "value", "verdict", "told"),
    [
        ("COM_RC_IN_MODE", 0, Verdict.FAIL, "set 1 (MAVLink only), with which PX4 ignores the transmitter"),
        ("COM_RC_IN_MODE", 3, Verdict.FAIL, "does not stop a mission"),
        ("NAV_RCL_ACT", 2, Verdict.FAIL, "set 1 (hold)"),
        ("NAV_RCL_ACT", 7, Verdict.FAIL, "set 1 (hold)"),
        ("COM_RC_LOSS_T", 1, Verdict.FAIL, "set 0.5 s"),
        ("COM_RC_LOSS_T", 0.2, Verdict.WARN, "set 0.5 s"),
        ("COM_FAIL_ACT_T", 5, Verdict.WARN, "set 0"),
        ("COM_RCL_EXCEPT", 1, Verdict.FAIL, "subtract 1"),
        ("COM_RCL_EXCEPT", 2, Verdict.WARN, "subtract 2"),
        ("COM_RCL_EXCEPT", 4, None, ""),
    ],
)
def test_the_dead_man_needs_the_fail_safe_for_lost_sticks(
    name: str, value: float, verdict: Verdict | None, told: str
) -> None:
    assert judge(PX4, Facts(GUARDED, deadman=True), holds=True) == []
    found = judge(PX4, Facts({**GUARDED, name: float(value)}, deadman=True), holds=True)
    assert [one.verdict for one in found] == ([] if verdict is None else [verdict])
    assert all(told in one.text and one.check == f"{name} {value:g}" for one in found)


def test_without_the_dead_man_only_a_transmitter_that_is_ignored_is_told() -> None:
    others = {**GUARDED, "COM_RC_IN_MODE": 3.0, "COM_RC_LOSS_T": 2.0, "COM_RCL_EXCEPT": 3.0}
    assert judge(PX4, Facts(others), holds=True) == []
    (found,) = judge(PX4, Facts(GUARDED), holds=True)
    assert found.check == "COM_RC_IN_MODE 1"
    assert "ignores the transmitter" in found.text


def test_a_parameter_that_the_dead_man_needs_and_that_was_not_told_fails() -> None:
    assert judge(PX4, Facts(GOOD_PX4), holds=True) == []
    found = judge(PX4, Facts(GOOD_PX4, deadman=True), holds=True)
    assert {(one.check, one.verdict) for one in found} == {
        ("COM_RC_IN_MODE untold", Verdict.FAIL),
        ("COM_RC_LOSS_T untold", Verdict.FAIL),
        ("COM_FAIL_ACT_T untold", Verdict.WARN),
        ("COM_RCL_EXCEPT untold", Verdict.FAIL),
    }


def test_where_nothing_is_held_by_policy_nothing_fails() -> None:
    bad = Facts({**GOOD, "MIS_RESTART": 1.0, "SCR_ENABLE": 0.0})
    assert {found.verdict for found in judge(ARDUPILOT, bad, holds=False)} == {Verdict.WARN}


def test_a_script_that_does_not_run_and_one_that_cannot_are_told_apart() -> None:
    without = {name: value for name, value in GOOD.items() if not name.startswith("ATS_")}
    (found,) = judge(ARDUPILOT, Facts(without), holds=True)
    assert "anytraverse.lua does not run" in found.text
    assert "SCR_HEAP_SIZE 122880" in found.text
    (found,) = judge(ARDUPILOT, Facts({**without, "SCR_ENABLE": 0.0}), holds=True)
    assert found.check == "SCR_ENABLE 0", "one reason is enough"
    none = {name: value for name, value in without.items() if not name.startswith("SCR_")}
    (found,) = judge(ARDUPILOT, Facts(none), holds=True)
    assert "runs no scripts" in found.text


@pytest.mark.parametrize(
    ("name", "policy", "told"),
    [
        ("ATS_NEED", "report", True),
        ("ATS_NEED", "off", True),
        ("ATS_NEED", "hold", False),
        ("ATS_POLICY", "shadow", True),
        ("ATS_POLICY", "off", False),
        ("ATS_POLICY", "hold", False),
    ],
)
def test_a_script_that_stops_more_than_the_companion_may_is_told(name: str, policy: str, told: bool) -> None:
    found = judge(ARDUPILOT, Facts({**GOOD, name: 1.0}, policy=policy), holds=policy == "hold")
    assert [one.check for one in found] == ([f"{name} 1"] if told else [])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ARMING_CHECK", 0.0),
        ("ARMING_CHECK", 72.0),
        ("ARMING_SKIPCHK", -1.0),
        ("ARMING_SKIPCHK", float(1 << 17)),
    ],
)
def test_a_demand_that_arming_does_not_ask_about_fails(name: str, value: float) -> None:
    (found,) = judge(ARDUPILOT, Facts({**GOOD, "ATS_NEED": 1.0, name: value}), holds=True)
    assert (found.check, found.verdict) == (f"{name} {value:g}", Verdict.FAIL)
    assert "lets it arm without a companion" in found.text
    assert judge(ARDUPILOT, Facts({**GOOD, name: value}), holds=True) == []


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ARMING_CHECK", 1.0),
        ("ARMING_CHECK", float(1 << 17)),
        ("ARMING_SKIPCHK", 0.0),
        ("ARMING_SKIPCHK", 72.0),
    ],
)
def test_a_demand_that_arming_asks_about_is_sound(name: str, value: float) -> None:
    assert judge(ARDUPILOT, Facts({**GOOD, "ATS_NEED": 1.0, name: value}), holds=True) == []


@pytest.mark.parametrize("value", [0.0, 3.0, 4.0])
@pytest.mark.parametrize("mode", [10.0, 15.0])
def test_an_autopilot_that_reboots_armed_in_a_mode_that_drives_is_warned_of(
    value: float, mode: float
) -> None:
    boots = {**GOOD, "ARMING_REQUIRE": value, "INITIAL_MODE": mode}
    (found,) = judge(ARDUPILOT, Facts(boots), holds=True)
    assert (found.check, found.verdict) == (f"ARMING_REQUIRE {value:g}", Verdict.WARN)
    assert "ATS_NEED 1" in found.text
    (found,) = judge(ARDUPILOT, Facts({**boots, "ATS_NEED": 1.0, "ARMING_CHECK": 1.0}), holds=True)
    assert "holds it until a go" in found.text


@pytest.mark.parametrize(("value", "mode"), [(3.0, 4.0), (3.0, 0.0), (1.0, 10.0), (2.0, 15.0)])
def test_one_that_a_person_arms_or_that_boots_in_a_mode_that_stands_is_sound(
    value: float, mode: float
) -> None:
    boots = {**GOOD, "ARMING_REQUIRE": value, "INITIAL_MODE": mode}
    assert judge(ARDUPILOT, Facts(boots), holds=True) == []


def test_an_off_switch_of_the_script_that_a_channel_has_is_sound() -> None:
    for option in (300.0, 307.0):
        assert judge(ARDUPILOT, Facts({**GOOD, "ATS_RC": option, "RC11_OPTION": option}), holds=True) == []
    (found,) = judge(ARDUPILOT, Facts({**GOOD, "ATS_RC": 300.0, "RC7_OPTION": 301.0}), holds=True)
    assert found.check == "ATS_RC 300"


def test_more_modes_than_must_be_guarded_may_be() -> None:
    assert judge(ARDUPILOT, Facts({**GOOD, "ATS_MODES": 33792.0 + 64 + 256}), holds=True) == []


@pytest.mark.parametrize("options", ["SERIAL2_OPTIONS", "MAV3_OPTIONS"])
def test_other_options_of_a_port_are_no_concern(options: str) -> None:
    assert judge(ARDUPILOT, Facts({**GOOD, options: 5.0}), holds=True) == []


def test_what_was_not_told_is_as_bad_as_it_may_be() -> None:
    untold = {name: value for name, value in GOOD.items() if name not in ("MIS_RESTART", "FS_ACTION")}
    found = judge(ARDUPILOT, Facts(untold), holds=True)
    assert [(one.check, one.verdict) for one in found] == [
        ("MIS_RESTART untold", Verdict.FAIL),
        ("FS_ACTION untold", Verdict.WARN),
    ]
    assert {one.verdict for one in judge(ARDUPILOT, Facts(untold), holds=False)} == {Verdict.WARN}
    newer = {"MAV_GCS_SYSID" if name == "SYSID_MYGCS" else name: value for name, value in GOOD.items()}
    assert judge(ARDUPILOT, Facts(newer), holds=True) == []


def test_offboard_holding_makes_more_of_the_loss_of_setpoints() -> None:
    for action in (0, 3):
        facts = Facts({**GOOD_PX4, "COM_OBL_RC_ACT": float(action)}, offboard=True)
        (found,) = judge(PX4, facts, holds=True)
        assert found.verdict is Verdict.FAIL


def test_a_port_of_px4_that_is_not_in_use_need_not_forward() -> None:
    facts = Facts({**GOOD_PX4, "MAV_1_FORWARD": 0.0, "MAV_1_CONFIG": 0.0})
    assert judge(PX4, facts, holds=True) == []


@pytest.mark.parametrize("others", [{"AVOID_ENABLE": 1.0}, {"PRX1_TYPE": 0.0}])
def test_a_vehicle_that_has_nothing_to_back_up_from_is_not_blamed(others: dict[str, float]) -> None:
    facts = Facts({**GOOD, "AVOID_BACKUP_SPD": 0.75, **others})
    assert judge(ARDUPILOT, facts, holds=True) == []
    second = Facts({**GOOD, "AVOID_BACKUP_SPD": 0.75, "PRX1_TYPE": 0.0, "PRX2_TYPE": 4.0})
    assert len(judge(ARDUPILOT, second, holds=True)) == 1


@pytest.mark.parametrize(
    ("autopilot", "values", "said"),
    [
        (ARDUPILOT, {"WP_SPEED": 0.0, "CRUISE_SPEED": 2.0}, ("CRUISE_SPEED", 2.0)),
        (ARDUPILOT, {"WP_SPEED": 3.0, "CRUISE_SPEED": 2.0}, ("WP_SPEED", 3.0)),
        (PX4, {"RO_SPEED_LIM": -1.0, "RO_MAX_THR_SPEED": 4.0}, ("RO_MAX_THR_SPEED", 4.0)),
        (PX4, {"RO_SPEED_LIM": 1.5}, ("RO_SPEED_LIM", 1.5)),
        (PX4, {}, None),
        (0, {"CRUISE_SPEED": 2.0}, None),
    ],
)
def test_how_fast_it_drives_by_itself_is_the_autopilot_s_word(
    autopilot: int, values: dict[str, float], said: tuple[str, float] | None
) -> None:
    assert speed(autopilot, values) == said


def test_every_parameter_is_asked_for_once_and_by_a_name_that_fits() -> None:
    for autopilot in (ARDUPILOT, PX4):
        asked = names(autopilot)
        assert len(set(asked)) == len(asked) <= 64
        assert all(0 < len(name) <= 16 for name in asked)
    assert names(0) == ()
