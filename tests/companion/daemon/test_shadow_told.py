"""What a person gets to know of shadow policy: texts, parameters, the status file, also over restarts."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.wire.ids import Policy
from tests.companion.daemon.rig import MANUAL, MakeRig, Rig


@pytest.fixture
def shadow(make_rig: MakeRig) -> Rig:
    """In shadow policy, driving in AUTO over grass."""
    return make_rig(Policy.SHADOW)


def figures(rig: Rig) -> dict[str, object]:
    found: dict[str, object] = rig.daemon.status.figures()["shadow"]
    return found


def would_hold(rig: Rig) -> list[str]:
    return [text for text in rig.texts if " would hold: " in text]


@pytest.mark.slow
def test_each_would_be_hold_is_told_with_its_number_but_not_faster_than_one_in_ten_seconds(
    shadow: Rig,
) -> None:
    for _ in range(8):
        shadow.see(1.0, "drum")
        shadow.see(2.0)
    assert figures(shadow)["would_hold"] == 8
    told = would_hold(shadow)
    assert told[0] == "S1 would hold: unknown thing"
    assert 2 <= len(told) <= 3
    assert shadow.stage.mode == 10


def test_the_counts_are_parameters_that_every_ground_station_reads(shadow: Rig) -> None:
    shadow.see(1.0, "drum")
    shadow.see(2.0)
    shadow.see(1.0, "rock")
    shadow.see(2.0)
    assert shadow.echoes("AT_SHD_HOLDS") == [1.0, 2.0]
    assert shadow.echoes("AT_SHD_OBJECT") == [1.0]
    assert shadow.echoes("AT_SHD_BLOCKED") == [1.0]


def test_the_counts_survive_kill_9_and_so_does_a_would_be_hold(shadow: Rig) -> None:
    shadow.see(1.0, "drum")
    shadow.see(2.0)
    shadow.see(1.0, "drum")
    shadow.restart()
    shadow.see(1.0, "drum")
    assert figures(shadow)["would_hold"] == 2
    assert figures(shadow)["standing"] == ["unknown_object"]
    shadow.see(2.0)
    assert figures(shadow)["standing"] == []
    shadow.see(1.0, "drum")
    assert would_hold(shadow) == ["S3 would hold: unknown thing"]


def test_the_counts_are_set_to_nothing_by_hand_and_to_nothing_else(shadow: Rig) -> None:
    shadow.see(1.0, "drum")
    shadow.see(2.0)
    shadow.set("AT_SHD_HOLDS", 7.0)
    shadow.see(0.5)
    assert figures(shadow)["would_hold"] == 1
    assert "AT_SHD_HOLDS takes 0: to count anew: kept" in shadow.texts
    shadow.set("AT_SHD_HOLDS", 0.0)
    shadow.see(0.5)
    assert figures(shadow)["would_hold"] == 0
    assert (shadow.echoes("AT_SHD_HOLDS")[-1], shadow.echoes("AT_SHD_OBJECT")[-1]) == (0.0, 0.0)
    shadow.set("AT_SHD_FAULT", 0.0)
    shadow.see(0.5)
    assert "AT_SHD_FAULT is read-only: kept" in shadow.texts


def test_the_sum_is_told_every_half_hour_that_was_watched(
    shadow: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    shadow.see(1.0, "drum")
    shadow.see(2.0)
    shadow.calls.shadow.watched += 1799.0
    shadow.see(2.0)
    (told,) = [text for text in shadow.texts if text.startswith("Shadow: ")]
    assert told == "Shadow: 1 in 0.5 h (2.0/h), most unknown thing"
    assert "1 would-be holds in 0.50 h (2.0 an hour); unknown_object 1 (2.0 an hour), mean 1." in caplog.text


def test_what_a_human_drives_is_not_watched(shadow: Rig) -> None:
    before = shadow.calls.shadow.watched
    shadow.stage.mode = MANUAL
    shadow.stage.heartbeat(1)
    shadow.see(5.0, "drum")
    assert shadow.calls.shadow.watched == pytest.approx(before, abs=0.2)
    assert would_hold(shadow) == []


def test_the_end_writes_the_sum_into_the_log(shadow: Rig, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    shadow.daemon.leave()
    assert "shadow: 0 would-be holds in 0.00 h" in caplog.text


def test_without_a_clock_of_its_own_a_would_be_hold_has_the_autopilots_time(shadow: Rig) -> None:
    wall = shadow.daemon.position.clock
    wall._wall = lambda: 100.0
    shadow.stage.send(mavlink.MAVLink_system_time_message(1_800_000_000_000_000, 1), (1, 1))
    shadow.see(1.0, "drum")
    (newest,) = shadow.settings.statistics.newest
    assert newest.at == pytest.approx(1_800_000_000.0, abs=2.0)
