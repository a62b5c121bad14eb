"""What the watchdog demands: a link that sends, and a view that is fresh or reported as faulty."""

from __future__ import annotations

import pytest

from companion.link.channel import Channel
from companion.wire.ids import Policy, State
from tests.companion.daemon.rig import MakeRig, Rig


def fed(rig: Rig) -> bool:
    return rig.loop.sees_or_reports_fault(rig.clock.now)


def test_fresh_frames_feed_it(rig: Rig) -> None:
    rig.see(3.0)
    assert fed(rig)


@pytest.mark.parametrize("policy", [Policy.REPORT, Policy.HOLD, Policy.OFF])
def test_a_fault_that_is_reported_feeds_it(make_rig: MakeRig, policy: Policy) -> None:
    rig = make_rig(policy)
    rig.wait(10.0)
    assert fed(rig)
    assert rig.state[0] == ("OFF" if policy is Policy.OFF else "FAULT")


def test_a_blind_daemon_that_says_ok_starves_it(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rig.calls, "state", lambda _: State.OK)
    rig.see(1.0)
    assert fed(rig)
    rig.wait(10.0)
    assert not fed(rig)


def test_a_connection_that_cannot_send_starves_it(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig.fails = True
    rig.see(1.0)
    with monkeypatch.context() as broken:
        broken.setattr(Channel, "tick", lambda *_, **__: 1 / 0)
        rig.see(1.0)
        assert not fed(rig)
    rig.see(1.0)
    assert fed(rig)
