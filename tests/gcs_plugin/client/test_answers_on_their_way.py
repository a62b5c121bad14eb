"""The operator's answers in virtual time, over a link that loses them: sent again, in order, applied once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from anytraverse.operations import SetWord
from companion.wire import ids
from companion.wire.answers import Acknowledgement, CancelIncident, PackIncident
from companion.wire.delivery import DeliveryStatus
from companion.wire.packing import PayloadError
from gcs_plugin.client import events as ev

if TYPE_CHECKING:
    from tests.gcs_plugin.conftest import Sky

MakeRover = Callable[..., Any]
BUSH = SetWord("bush", -1.0)


def test_an_answer_is_applied_acknowledged_and_closes_the_call(sky: Sky) -> None:
    sky.run(2.0)
    pending = sky.answer(BUSH)
    sky.run(1.0)
    assert pending.status is DeliveryStatus.ACKNOWLEDGED
    assert sky.rover.applied == [(7, ids.Motion.GO, (BUSH,))]
    assert [event.call.outcome for event in sky.of(ev.CallEnded)] == [ids.Outcome.ANSWERED]
    sky.run(70.0)
    assert len(sky.sent) == 1


@pytest.mark.parametrize("n", [3, 5, 7])
def test_an_answer_survives_the_loss_of_every_nth_message_both_ways(sky: Sky, n: int) -> None:
    sky.lose_up = sky.lose_down = lambda count: count % n == 0
    sky.run(5.0)
    pending = sky.answer(BUSH)
    sky.run(60.0)
    assert pending.status in (DeliveryStatus.ACKNOWLEDGED, DeliveryStatus.CLOSED)
    assert sky.rover.applied == [(7, ids.Motion.GO, (BUSH,))]
    assert len(sky.of(ev.CallEnded)) == 1
    lost = sky.client.rovers[1].counters
    assert lost.summaries + lost.summaries_lost == pytest.approx(sky.rover.sequence, abs=2)


def test_it_is_sent_again_with_back_off_and_given_up_after_a_minute(sky: Sky) -> None:
    sky.run(2.0)
    sky.lose_down = lambda _: True
    pending = sky.answer(BUSH)
    start = sky.now
    sky.run(70.0)
    assert [round(at - start) for at in sky.sent] == [0, 1, *range(3, 60, 4)]
    assert pending.status is DeliveryStatus.EXPIRED
    assert sky.of(ev.AnswerStatusChanged)[-1].status is DeliveryStatus.EXPIRED


def test_a_lost_acknowledgement_is_fetched_by_sending_again_and_applied_once(sky: Sky) -> None:
    sky.rover.stage_after = ids.Stage.ANSWERED
    sky.run(2.0)
    lost_until = sky.now + 2.5
    sky.lose_up = lambda _: sky.now < lost_until
    pending = sky.answer(BUSH)
    sky.run(10.0)
    assert pending.status is DeliveryStatus.ACKNOWLEDGED
    assert len(sky.rover.applied) == 1
    assert len(sky.sent) == 3


def test_a_call_that_is_closed_by_something_else_ends_the_sending(sky: Sky) -> None:
    sky.run(2.0)
    sky.lose_down = lambda _: True
    pending = sky.answer(BUSH)
    sky.run(1.5)
    sky.rover.call = replace(sky.rover.call, stage=ids.Stage.CLOSED, outcome=ids.Outcome.PASSED)
    sky.run(1.0)
    assert [event.call.outcome for event in sky.of(ev.CallEnded)] == [ids.Outcome.PASSED]
    sent = len(sky.sent)
    sky.run(10.0)
    assert pending.status is DeliveryStatus.CLOSED
    assert len(sky.sent) == sent


def test_a_duplicate_acknowledgement_changes_nothing(sky: Sky) -> None:
    sky.run(2.0)
    sky.answer(BUSH)
    sky.run(1.0)
    before = list(sky.told)
    for frame in sky.rover._acknowledgements.values():
        sky.hear(sky.rover.companion.tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, frame))
    assert sky.client.rovers[1].counters.duplicate_acknowledgements == 1
    assert sky.client.events() == []
    assert len(sky.told) == len(before)


def test_a_stale_answer_is_told_and_not_repeated(sky: Sky) -> None:
    sky.rover.result = ids.Result.STALE
    sky.run(2.0)
    sky.answer(target=3)
    sky.run(20.0)
    assert [event.acknowledgement.result for event in sky.of(ev.Acknowledged)] == [ids.Result.STALE]
    assert len(sky.sent) == 1


def test_a_busy_rover_is_asked_again(sky: Sky) -> None:
    sky.rover.result, sky.rover.stage_after = ids.Result.BUSY, ids.Stage.OPEN
    sky.run(2.0)
    pending = sky.answer(BUSH)
    sky.run(4.0)
    assert not pending.settled
    assert len(sky.sent) == 3
    sky.rover.result, sky.rover.stage_after = ids.Result.APPLIED, ids.Stage.CLOSED
    sky.rover._acknowledgements.clear()
    sky.run(8.0)
    assert pending.status is DeliveryStatus.ACKNOWLEDGED


def test_a_stay_waits_for_no_go_and_no_go_is_sent_after_it(sky: Sky) -> None:
    sky.rover.result, sky.rover.stage_after = ids.Result.BUSY, ids.Stage.OPEN
    sky.run(2.0)
    go = sky.answer(BUSH)
    sky.run(0.5)
    sky.rover.result, sky.rover.stage_after = ids.Result.APPLIED, ids.Stage.OPEN
    sky.rover._acknowledgements.clear()
    sky.rover.applied.clear()
    stay = sky.answer(motion=ids.Motion.STAY)
    sky.run(0.2)
    assert stay.status is DeliveryStatus.ACKNOWLEDGED
    sky.run(20.0)
    assert sky.rover.applied == [(7, ids.Motion.STAY, ())]
    assert go.status is DeliveryStatus.CLOSED


def test_what_is_cancelled_is_not_asked_for_any_more(sky: Sky) -> None:
    sky.run(2.0)
    sky.lose_up = lambda _: True
    cancelled, other = (sky.answer(PackIncident(one), motion=ids.Motion.NONE, target=0) for one in (7, 8))
    sky.run(1.0)
    sky.answer(CancelIncident(7), motion=ids.Motion.NONE, target=0)
    sky.run(20.0)
    assert cancelled.status is DeliveryStatus.CLOSED
    assert not other.settled


def test_a_rover_that_is_busy_too_late_is_not_said_to_be_asked_again(sky: Sky) -> None:
    sky.rover.result, sky.rover.stage_after = ids.Result.BUSY, ids.Stage.OPEN
    sky.run(2.0)
    sky.lose_up = lambda _: bool(sky.sent)
    pending = sky.answer(BUSH)
    sky.run(61.0)
    assert pending.status is DeliveryStatus.EXPIRED
    late = Acknowledgement(
        pending.answer.transaction, 7, ids.Result.BUSY, ids.Stage.OPEN, ids.Outcome.NONE,
        None, None, ids.Reasons.NONE, 99, "vision is busy",
    )  # fmt: skip
    sky.hear(sky.rover.companion.tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, late.pack()))
    sky.run(1.0)
    assert sky.of(ev.Acknowledged) == []


def test_nothing_is_sent_to_a_rover_that_is_silent_for_three_seconds(sky: Sky) -> None:
    sky.run(2.0)
    sky.rover_speaks = False
    sky.run(4.0)
    assert sky.of(ev.LinkChanged)[-1] == ev.LinkChanged(1, up=False)
    pending = sky.answer(BUSH)
    sky.run(10.0)
    assert (pending.status, sky.sent) == (DeliveryStatus.WAITING, [])
    assert sky.of(ev.AnswerStatusChanged)[-1].status is DeliveryStatus.WAITING
    sky.rover_speaks = True
    sky.run(2.0)
    assert pending.status is DeliveryStatus.ACKNOWLEDGED


def test_nothing_is_sent_to_a_rover_that_was_never_heard(sky: Sky) -> None:
    sky.rover_speaks = False
    sky.answer(BUSH)
    sky.client.request_parameters(1)
    sky.run(61.0)
    assert sky.sent == []
    assert sky.of(ev.AnswerStatusChanged)[-1].status is DeliveryStatus.EXPIRED


def test_a_long_answer_goes_in_parts_at_a_pace_that_radios_bear(sky: Sky) -> None:
    words = tuple(SetWord(f"a word that is long enough to fill {number}", 0.5) for number in range(8))
    sky.run(2.0)
    pending = sky.answer(*words)
    sky.run(2.0)
    assert pending.status is DeliveryStatus.ACKNOWLEDGED
    assert sky.rover.applied == [(7, ids.Motion.GO, words)]
    assert len(sky.sent) == 4
    assert min(b - a for a, b in zip(sky.sent, sky.sent[1:], strict=False)) >= 0.05 - 1e-9


def test_a_part_that_is_lost_comes_again_with_all_the_others(sky: Sky) -> None:
    words = tuple(SetWord(f"a word that is long enough to fill {number}", 0.5) for number in range(4))
    sky.run(2.0)
    sky.lose_down = lambda count: count == 2
    sky.answer(*words)
    sky.run(3.0)
    assert sky.rover.applied == [(7, ids.Motion.GO, words)]


def test_answers_to_one_rover_keep_their_order(sky: Sky) -> None:
    sky.rover.stage_after = ids.Stage.ANSWERED
    sky.run(2.0)
    sky.lose_down = lambda count: count == 1
    sky.answer(BUSH, motion=ids.Motion.NONE)
    sky.answer(motion=ids.Motion.GO)
    sky.run(10.0)
    assert [motion for _, motion, _ in sky.rover.applied] == [ids.Motion.NONE, ids.Motion.GO]


def test_an_answer_that_is_never_acknowledged_keeps_the_next_one_back_for_eight_seconds(sky: Sky) -> None:
    sky.run(2.0)
    sky.unheard.add(sky.answer(BUSH, motion=ids.Motion.NONE).answer.transaction)
    second = sky.answer(motion=ids.Motion.LOOK_AGAIN)
    sky.run(7.0)
    assert second.first_sent is None
    sky.run(2.0)
    assert second.status is DeliveryStatus.ACKNOWLEDGED


def test_what_cannot_be_told_on_the_wire_is_refused_at_once(sky: Sky) -> None:
    with pytest.raises(PayloadError, match="send them in two"):
        sky.answer(*[SetWord("a word of some length", 1.0)] * 33)
    with pytest.raises(PayloadError, match="shorter word"):
        sky.answer(SetWord("ü" * 49, 1.0))
