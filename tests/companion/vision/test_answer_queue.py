"""Answers take their turns with new frames, whatever the two cost."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from anytraverse.operations import SetWord
from companion.vision.answer_queue import WITHOUT_FRAMES, AnswerQueue
from companion.vision.messages import Apply


def answer(number: int) -> Apply:
    return Apply(number, (SetWord("drum", -1.0),), 0, 0, go=False, place=None)


@given(st.integers(1, 12), st.floats(0.001, 3.0), st.floats(0.001, 1.0), st.floats(0.01, 1.0))
def test_judging_again_takes_no_more_time_than_judging_and_no_two_in_a_row(
    count: int, again: float, frame: float, period: float
) -> None:
    queue, now, due = AnswerQueue(), 0.0, 0.0
    order, spent = list[int](), {"frames": 0.0, "again": 0.0}
    for number in range(count):
        queue.add(answer(number))
    while len(order) < count:
        began = now
        request = queue.take(now)
        if request is not None:
            order.append(request.number)
            assert spent["again"] <= now - spent["again"] + 1e-6, "as long as all else so far, at most"
            now += again
            spent["again"] += again
            queue.handled(began, now)
        if now >= due:
            due = max(due + period, now)
            now += frame
            spent["frames"] += frame
            queue.judged()
        now += 0.02
        assert now <= count * (2 * again + frame + period + 0.1) + again
    assert order == list(range(count))


def test_without_frames_answers_go_on() -> None:
    queue = AnswerQueue()
    queue.add(answer(1))
    queue.add(answer(2))
    assert queue.take(0.0) is not None
    queue.handled(0.0, 0.1)
    assert queue.take(0.1 + WITHOUT_FRAMES - 0.01) is None
    assert queue.take(0.1 + WITHOUT_FRAMES) is not None
    assert queue.take(9.0) is None


def test_an_answer_waits_for_a_frame_and_for_as_long_as_the_one_before_took() -> None:
    queue = AnswerQueue()
    queue.add(answer(1))
    queue.add(answer(2))
    queue.take(0.0)
    queue.handled(0.0, 0.2)
    queue.judged()
    assert queue.take(0.39) is None
    assert queue.take(0.4) is not None
