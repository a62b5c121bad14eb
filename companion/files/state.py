"""/state.json: what counts on the rover now, for programs, in about 2 kB."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from anytraverse.release import own_version
from companion.calls.machine import OperatorCalls
from companion.conversation import Conversation
from companion.keeper import Keeper
from companion.places import place_figures
from companion.settings_desk import SettingsDesk
from companion.telling import current_data
from companion.whereabouts import Whereabouts
from companion.wire.ids import VERSION
from companion.wire.payloads import CallData

_DIGITS = 4
_OF_THE_LINK = ("trouble", "autopilot", "dropped_summaries", "lost", "unsaid", "rejected")


class State:
    """Looks at the parts and changes none."""

    def __init__(
        self,
        status: Callable[[], Mapping[str, Any]],
        calls: OperatorCalls,
        conversation: Conversation,
        desk: SettingsDesk,
        keeper: Keeper,
        whereabouts: Whereabouts,
    ) -> None:
        """status: the figures of the status file."""
        self._status = status
        self._calls = calls
        self._conversation = conversation
        self._desk = desk
        self._keeper = keeper
        self._whereabouts = whereabouts
        self._release = own_version()

    def figures(self) -> dict[str, Any]:
        """All of it as JSON values."""
        status, words, place = self._status(), self._conversation.words, self._whereabouts.place()
        picture = self._keeper.picture_of(self._calls.current_id)
        told = current_data(self._calls, words, place, picture, time.monotonic())
        return {
            "version": self._release,
            "protocol": VERSION,
            "model": status["perceiver"]["model"],
            "state": status["state"],
            "policy": status["policy"],
            "hold_refused": status["hold_refused"],
            "reasons": status["reasons"],
            "held_by": status["held_by"],
            "latency_ms": status["latency_ms"],
            "open": None if told is None else _open(told),
            "words": {word: round(words[word], _DIGITS) for word in words},
            "vocabulary": self._desk.vocabulary,
            "settings": {name: round(value, _DIGITS) for name, value in self._desk.settings.items()},
            "set_by_ground": sorted(status["set_by_ground"]),
            "place": place_figures(place),
            "link": {name: status["link"][name] for name in _OF_THE_LINK},
        }


def _open(told: CallData) -> dict[str, Any]:
    figures = {
        "roi_uncertainty": told.roi_uncertainty,
        "worst_tile": told.worst_tile,
        "drivable_share": told.drivable_share,
        "similarity": told.similarity,
    }
    return {
        "id": told.id,
        "kind": told.kind.name.lower(),
        "stage": told.stage.name.lower(),
        "holding": told.holding,
        "age": told.age_s,
        "frame_id": told.frame_id,
        "worst_tile_box": told.worst_tile_box and [round(side, _DIGITS) for side in told.worst_tile_box],
        **{name: value and round(value, _DIGITS) for name, value in figures.items()},
        "picture": told.picture,
    }
