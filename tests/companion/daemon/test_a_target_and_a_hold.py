"""A target by which the vehicle is driven never leaves behind the command to hold it."""

from __future__ import annotations

import pytest

from companion.daemon.guiding import GuideService
from tests.companion.daemon.rig import Rig


def test_no_target_is_sent_once_a_hold_begins(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def always(_: GuideService, __: float) -> None:
        rig.stage.link.setpoints.target = (1.0, 0.0)

    monkeypatch.setattr(GuideService, "tick", always)
    rig.see(1.0)
    assert len(rig.stage.sent("SET_POSITION_TARGET_LOCAL_NED")) >= 9
    rig.see(1.0, "drum")
    assert rig.calls.hold is not None
    frames = [one.message for one in rig.stage.frames]
    held = next(n for n, one in enumerate(frames) if one.get_type() == "COMMAND_LONG" and one.command == 176)
    assert not any(one.get_type() == "SET_POSITION_TARGET_LOCAL_NED" for one in frames[held:])
