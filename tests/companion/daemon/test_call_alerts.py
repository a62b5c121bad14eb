"""The owner's URL is told of each call and hold once, with its text and place."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from anytraverse.history import Place
from companion.daemon.call_alerts import CallAlerts
from companion.system.alert import Alert
from companion.wire.ids import Kind

HERE = Place(latitude=47.0001, longitude=8.0)


class Play:
    """What the observer reads, and what it sent."""

    def __init__(self, open_id: int = 0) -> None:
        self.calls = SimpleNamespace(current_id=open_id, kind=Kind.CALL)
        self.texts = SimpleNamespace(told="")
        self.sent: list[Alert] = []
        sender: Any = SimpleNamespace(send=self.sent.append)
        calls: Any = self.calls
        texts: Any = self.texts
        self.alerts = CallAlerts(calls, texts, sender, "https://rover/")

    def see(self, now: float, current_id: int, told: str = "", place: Place = HERE) -> None:
        self.texts.told = told
        turn: Any = SimpleNamespace(now=now, current_id=current_id, place=place)
        self.alerts.see(turn)


def test_a_call_is_alerted_once_with_its_text_place_and_link() -> None:
    play = Play()
    for now in range(5):
        play.see(float(now), 7, "C7 unknown 91% in yellow frame, over 25% calls")
    text = "C7 unknown 91% in yellow frame, over 25% calls\nat 47.00010 8.00000\nhttps://rover/"
    assert play.sent == [Alert("A rover calls: C7", text, "https://rover/")]
    play.see(6.0, 0)
    play.see(7.0, 8, "C8 new place", Place())
    assert [one.text for one in play.sent[1:]] == ["C8 new place\nhttps://rover/"]


def test_one_whose_text_does_not_come_is_alerted_all_the_same_and_soon() -> None:
    play = Play()
    play.see(0.0, 7, "Companion sees again")
    assert play.sent == []
    play.see(2.0, 7, "Companion sees again")
    assert [one.title for one in play.sent] == ["A rover calls: C7"]


def test_one_that_was_open_before_a_restart_is_not_alerted_again() -> None:
    play = Play(open_id=7)
    play.see(0.0, 7, "C7 unknown")
    assert play.sent == []


def test_a_hold_that_is_shown_again_after_calls_is_alerted_once() -> None:
    play = Play()
    for now, number in enumerate((4, 5, 4, 6, 4)):
        play.see(float(now), number, f"C{number} unknown")
    assert [one.title for one in play.sent] == [f"A rover calls: C{number}" for number in (4, 5, 6)]
