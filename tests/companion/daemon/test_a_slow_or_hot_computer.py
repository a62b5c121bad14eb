"""What the ground is told when frames are judged less often."""

from __future__ import annotations

from typing import Any

import pytest

from tests.companion.daemon.rig import MakeRig

COOL: dict[str, Any] = {"temperature": 50.0, "throttled": False}


@pytest.mark.slow
def test_each_step_is_told_once_and_in_the_status(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.see(1.0)
    rig.daemon.computer.newest = {"temperature": 85.0, "throttled": False}
    rig.see(12.0)
    assert rig.texts.count("Judges 7.5/s of 10: hot computer") == 1
    told = rig.daemon.status.figures()["judging"]
    assert told == {"rate": 7.5, "configured": 10.0, "lowered_by": "hot computer"}
    assert rig.daemon.status.state_file()["judging"] == told
    rig.see(35.0)
    assert rig.texts.count("Hot computer: cannot judge less, cool it") == 1
    rig.daemon.computer.newest = COOL
    rig.see(80.0)
    assert rig.texts.count("Judges 10/s again") == 1
    assert rig.state[0] == "OK"
    assert rig.daemon.status.figures()["judging"]["lowered_by"] == ""
