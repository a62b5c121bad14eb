"""What was told counts while it is fresh; what is not known to be well is not well."""

from __future__ import annotations

import pytest

from bench.virtual_time import Clock
from companion.observers.page.messages import PageMessageKind
from companion.observers.page.news import FRESH, PICTURE_FRESH, News
from companion.system.datagrams import Datagram


def told(state: object, at: float) -> Datagram:
    return Datagram(PageMessageKind.NEWS, {"told": "", "status": {"state": state}, "at": at})


def test_nothing_is_well_before_the_first_news() -> None:
    news = News(Clock())
    assert news.trouble() == "no news from the companion"
    assert news.event()["age"] is None


@pytest.mark.parametrize("state", ["ok", "calling", "holding", "blocked", "off"])
def test_a_state_in_which_it_does_its_work_is_well_until_the_news_are_old(state: str) -> None:
    clock = Clock()
    news = News(clock)
    news.take(told(state, clock.now))
    clock.sleep(FRESH)
    assert news.trouble() == ""
    clock.sleep(0.01)
    assert news.trouble() == "no news from the companion"


@pytest.mark.parametrize("state", ["fault", "starting", "a new one", "", None, 7, ["ok"]])
def test_any_other_state_is_not_known_to_be_well(state: object) -> None:
    clock = Clock()
    news = News(clock)
    news.take(told(state, clock.now))
    assert news.trouble() not in ("", "no news from the companion")


def test_it_says_since_when_the_state_lasts_and_whether_it_saw_the_beginning() -> None:
    clock = Clock()
    news = News(clock)
    news.take(told("ok", clock.now))
    clock.sleep(5.0)
    news.take(told("ok", clock.now))
    assert (news.event()["since"], news.event()["exact"]) == (5.0, False)
    news.take(told("calling", clock.now))
    clock.sleep(2.0)
    assert (news.event()["since"], news.event()["exact"]) == (2.0, True)


def test_what_waited_on_its_way_is_as_old_as_it_was_then() -> None:
    clock = Clock()
    news = News(clock)
    news.take(told("ok", clock.now - FRESH - 0.01))
    news.take(
        Datagram(PageMessageKind.PICTURE, {"frame": 3, "at": clock.now - PICTURE_FRESH - 0.01}, b"jpeg")
    )
    assert news.trouble() == "no news from the companion"
    assert news.shown_picture() is None


def test_a_time_that_is_still_to_come_makes_nothing_last_longer() -> None:
    clock = Clock()
    news = News(clock)
    news.take(told("ok", clock.now + 86400.0))
    clock.sleep(FRESH + 0.01)
    assert news.trouble() == "no news from the companion"


def test_a_picture_is_shown_while_it_is_fresh_and_never_again() -> None:
    clock = Clock()
    news = News(clock)
    news.take(Datagram(PageMessageKind.PICTURE, {"frame": 3, "at": clock.now - 1.0}, b"jpeg"))
    clock.sleep(PICTURE_FRESH - 1.0)
    shown = news.shown_picture()
    assert shown is not None
    assert (shown.frame, shown.jpeg) == (3, b"jpeg")
    clock.sleep(0.01)
    assert news.shown_picture() is None


def test_the_ground_from_above_is_that_of_the_newest_picture_or_none() -> None:
    clock = Clock()
    news = News(clock)
    for content in (b"png", b""):
        news.take(Datagram(PageMessageKind.MAP, {"at": clock.now}, content))
        assert news.from_above == content


@pytest.mark.parametrize(
    "message",
    [
        Datagram(PageMessageKind.SETUP, {}),
        Datagram(PageMessageKind.PICTURE, {"frame": 1}, b"x"),
        Datagram(PageMessageKind.PICTURE, {"frame": "1", "at": 0.0}, b"x"),
        Datagram(PageMessageKind.PICTURE, {"frame": 1, "at": "now"}, b"x"),
        Datagram(PageMessageKind.NEWS, {"status": {"state": "ok"}}),
        Datagram(PageMessageKind.MAP, {}, b"x"),
    ],
)
def test_what_the_supervisor_never_says_is_refused(message: Datagram) -> None:
    with pytest.raises(ValueError, match=r"setup|without"):
        News(Clock()).take(message)
