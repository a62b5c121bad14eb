"""Rovers that somebody invents: the table has a place for each rover that is heard, and forgets others."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.wire.call_report import CallReport
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import KEPT_S, MAX_ROVERS, MOST_SENT, OperatorClient
from gcs_plugin.client.rovers import FRESH_S
from tests.gcs_plugin.conftest import THING_CALL, TextSender, TinyRover

if TYPE_CHECKING:
    from tests.gcs_plugin.conftest import Sky

MakeRover = Callable[..., Any]
REAL = 1
FORGED = range(2, 256)


def beats(systems: Iterable[int]) -> list[bytes]:
    return [TinyRover(system).heartbeat() for system in systems]


def claims(systems: Iterable[int]) -> list[bytes]:
    """Heartbeats with an open call."""
    calling = [TinyRover(system, replace(THING_CALL, id=system)) for system in systems]
    return [frame for rover in calling for frame in (rover.heartbeat(), *rover.call_frames())]


def test_a_full_table_forgets_the_rover_that_is_silent_longest(sky: Sky) -> None:
    for system in FORGED[:MAX_ROVERS]:
        sky.hear(*beats([system]))
        sky.now += 1.0
    sky.run(0.05)
    assert sorted(sky.client.rovers) == [REAL, *FORGED[1:MAX_ROVERS]], "it came when 2 was silent longest"
    sky.run(60.0)
    assert len(sky.client.rovers) == MAX_ROVERS
    assert sky.of(ev.CallAnnounced) == [ev.CallAnnounced(REAL, sky.client.rovers[REAL].calls[7].data)]


@pytest.mark.slow
def test_forged_rovers_with_open_calls_keep_nobody_out_and_are_forgotten(sky: Sky) -> None:
    sky.hear(*claims(FORGED))
    sky.run(1.0)
    assert sorted(sky.client.rovers) == [REAL, *FORGED], "all have an open call"
    sky.run(KEPT_S)
    assert len(sky.client.rovers) == MAX_ROVERS
    assert sky.client.rovers[REAL].open_calls()


@pytest.mark.slow
def test_a_flood_forgets_no_rover_that_calls_within_ten_minutes_of_silence(sky: Sky) -> None:
    sky.run(1.0)
    sky.rover_speaks = False
    until = sky.now + KEPT_S - 20.0
    while sky.now < until:
        sky.hear(*claims(FORGED))
        sky.now += 10.0
        sky.run(0.1)
    assert sky.client.rovers[REAL].open_calls()


def test_an_answer_reaches_the_rover_among_all_forged_ones(sky: Sky) -> None:
    sky.run(1.0)
    for system in FORGED:
        sky.client.fetch(system, "/state.json", sky.now)
    sky.answer()
    for _ in range(4):
        sky.hear(*beats(FORGED))
        before = len(sky.sent)
        sky.run(0.5)
        assert len(sky.sent) - before <= 10 * MOST_SENT
    assert [target for target, _, _ in sky.rover.applied] == [7]


def test_a_rover_that_was_forgotten_and_comes_again_is_told_anew(sky: Sky) -> None:
    sky.rover.call = None
    sky.run(1.0)
    sky.rover_speaks = False
    sky.run(5.0)
    sky.hear(*beats(FORGED))
    sky.run(1.0)
    assert REAL not in sky.client.rovers
    sky.rover_speaks = True
    sky.run(2.0)
    assert [one.up for one in sky.of(ev.LinkChanged) if one.system == REAL] == [True, False, True]


class Told(NamedTuple):
    """What one system says: a heartbeat, after `pause` seconds. calls: with an open call."""

    pause: float
    system: int
    calls: bool


CALL_OF: dict[bool, CallReport | None] = {True: THING_CALL, False: None}
TOLD = st.builds(
    Told,
    st.one_of(st.just(0.0), st.floats(0.0, 4.0), st.sampled_from([FRESH_S, 60.0, KEPT_S])),
    st.integers(1, 255),
    st.booleans(),
)


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(st.lists(st.lists(TOLD, min_size=1, max_size=40), max_size=6))
def test_whoever_is_heard_is_in_the_table_and_the_silent_do_not_fill_it(bursts: list[list[Told]]) -> None:
    client, ground = OperatorClient(), TextSender(255, 190)
    now, heard = 100.0, dict[int, float]()
    for burst in bursts:
        for told in burst:
            now += told.pause
            rover = TinyRover(told.system, CALL_OF[told.calls])
            for message in ground.parse(b"".join([*rover.call_frames(), rover.heartbeat()])):
                client.receive(message, now)
            heard[told.system] = now
            client.outgoing(now)
        known = client.rovers
        silence = {system: now - at for system, at in heard.items()}
        live = {system for system, seconds in silence.items() if seconds < FRESH_S}
        kept = {one for one, rover in known.items() if rover.open_calls() and silence[one] < KEPT_S}
        assert live <= known.keys()
        assert len(known) <= max(MAX_ROVERS, len(live | kept))
        forgotten = [silence[one] for one in silence.keys() - known.keys()]
        others = [silence[one] for one in known.keys() - live if not known[one].open_calls()]
        assert not others or all(seconds >= max(others) for seconds in forgotten)
