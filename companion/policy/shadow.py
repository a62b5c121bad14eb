"""Shadow policy: how many holds there would have been, for what and for how long, and telling of them."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from typing import Any

from anytraverse.assessment import Assessment, Reason
from companion.calls.decisions import WouldHold, WouldResume
from companion.calls.machine import OperatorCalls
from companion.calls.shadow import Shadow
from companion.link.link import Link
from companion.wire import notices
from companion.wire.ids import Policy, State
from companion.wire.parameters import MANY, SHADOW_HOLDS, SHADOW_HOURS, SHADOW_REASONS

log = logging.getLogger(__name__)


ENOUGH_HOURS = 0.1
"""Less says nothing about a rate."""
_NEWEST = 50
_KEEP_EVERY = 60.0
"""Seconds watched that a kill -9 may cost, so that a memory card is not worn out by a counter."""
_LARGEST = 1e11
"""As a Unix time a year that a date can still tell."""
_REASONS = tuple(reason.value for reason in Reason)


@dataclass
class Count:
    """Would-be holds that began for one reason; one that began for two counts under both.

    seconds, longest: of those that frames ended; by_hand: ended by a human, whose length says nothing.
    """

    holds: int = 0
    ended: int = 0
    seconds: float = 0.0
    longest: float = 0.0
    by_hand: int = 0

    def end(self, lasted: float, *, by_hand: bool) -> None:
        """One of them is over."""
        if by_hand:
            self.by_hand += 1
        else:
            self.ended, self.seconds = self.ended + 1, self.seconds + lasted
            self.longest = max(self.longest, lasted)


@dataclass
class Entry:
    """One would-be hold. at: Unix time of its beginning. lasted: seconds, None while it stands."""

    number: int
    at: float
    reasons: list[str]
    lasted: float | None = None
    by_hand: bool = False


@dataclass
class ShadowStatistics:
    """Fed by the decisions; counts survive a restart and begin anew with another model or by command.

    since: Unix time of the first entry's chance, 0 before anything was watched.
    """

    model: str = ""
    since: float = 0.0
    counts: dict[str, Count] = field(default_factory=lambda: {name: Count() for name in _REASONS})
    newest: deque[Entry] = field(default_factory=lambda: deque(maxlen=_NEWEST))
    _saved: dict[str, Any] | None = None

    def began(self, hold: WouldHold, wall: float) -> None:
        """A would-be hold begins at Unix time `wall`."""
        self._saved = None
        reasons = sorted(reason.value for reason in hold.reasons)
        self.newest.append(Entry(hold.number, wall, reasons))
        for name in reasons:
            self.counts[name].holds += 1

    def ended(self, hold: WouldResume) -> None:
        """It is over."""
        self._saved = None
        for reason in hold.reasons:
            self.counts[reason.value].end(hold.lasted, by_hand=hold.by_hand)
        if self.newest and self.newest[-1].number == hold.number:
            self.newest[-1].lasted, self.newest[-1].by_hand = round(hold.lasted, 2), hold.by_hand

    def figures(self, shadow: Shadow) -> dict[str, Any]:
        """For the status file. per_hour: null before there were six minutes to count in."""
        hours = shadow.watched / 3600
        return {
            "since": _iso(self.since),
            "watched_hours": round(hours, 4),
            "would_hold": shadow.count,
            "per_hour": rate(shadow.count, hours),
            "by_reason": {
                name: {
                    "would_hold": count.holds,
                    "per_hour": rate(count.holds, hours),
                    "mean_s": round(count.seconds / count.ended, 1) if count.ended else None,
                    "longest_s": round(count.longest, 1) if count.ended else None,
                    "by_hand": count.by_hand,
                }
                for name, count in self.counts.items()
            },
            "standing": sorted(reason.value for reason in shadow.open),
            "newest": [{**asdict(entry), "at": _iso(entry.at)} for entry in reversed(self.newest)],
        }

    def line(self, shadow: Shadow) -> str:
        """For the log: all that counts on one line."""
        hours = shadow.watched / 3600
        parts = [
            f"{name} {count.holds}{_per_hour(rate(count.holds, hours))}"
            + (
                f", mean {count.seconds / count.ended:.1f} s, longest {count.longest:.1f} s"
                * bool(count.ended)
            )
            for name, count in self.counts.items()
            if count.holds
        ]
        total = f"{shadow.count} would-be holds in {hours:.2f} h{_per_hour(rate(shadow.count, hours))}"
        return "; ".join([total, *parts])

    def text(self, shadow: Shadow) -> str:
        """For the operator."""
        hours = shadow.watched / 3600
        most = max(self.counts, key=lambda name: self.counts[name].holds) if shadow.count else ""
        return notices.shadow_so_far(shadow.count, hours, most)

    def values(self, shadow: Shadow) -> dict[str, float]:
        """Parameter name -> value; the hours in tenths, so that they are no stream of their own."""
        counts = {SHADOW_REASONS[name]: float(count.holds) for name, count in self.counts.items()}
        hours = math.floor(shadow.watched / 360) / 10
        values = {SHADOW_HOLDS: float(shadow.count), SHADOW_HOURS: hours} | counts
        return {name: min(value, MANY) for name, value in values.items()}

    def begin_anew(self, shadow: Shadow, wall: float) -> None:
        """Forget what was counted."""
        shadow.begin_anew()
        self.since, self._saved = wall, None
        self.counts = {name: Count() for name in _REASONS}
        self.newest.clear()

    def saved(self, shadow: Shadow, now: float) -> dict[str, Any]:
        """As JSON values; the same object until there is something worth a write."""
        if self._saved is None or abs(shadow.watched - self._saved["watched"]) >= _KEEP_EVERY:
            self._saved = {
                "model": self.model,
                "since": self.since,
                "count": shadow.count,
                "watched": shadow.watched,
                "open": sorted(reason.value for reason in shadow.open),
                "lasted": now - shadow.began_at if shadow.open else 0.0,
                "counts": {name: asdict(count) for name, count in self.counts.items()},
                "newest": [asdict(entry) for entry in self.newest],
            }
        return self._saved

    @classmethod
    def restored(
        cls, saved: Any, shadow: Shadow, model: str, now: float, wall: float
    ) -> tuple[ShadowStatistics, str]:
        """The book as `saved` left it, `shadow` with it, and what to say: "" unless it had to begin anew."""
        statistics = cls(model=model, since=wall)
        if saved is None:
            return statistics, ""
        try:
            if saved["model"] != model:
                return statistics, f"shadow counts were another model's ({saved['model']}): begun anew"
            counts = {name: _count(saved["counts"].get(name, {})) for name in _REASONS}
            entries = [_entry(entry) for entry in saved["newest"]]
            opened = frozenset(Reason(value) for value in saved["open"])
            since, lasted = _figure(saved["since"]), _figure(saved["lasted"])
            count, watched = int(_figure(saved["count"])), _figure(saved["watched"])
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            return statistics, f"shadow counts cannot be read ({error!r}): begun anew"
        shadow.count, shadow.watched = count, watched
        shadow.open, shadow.began_at = opened, now - lasted
        statistics.since, statistics.counts = since, counts
        statistics.newest.extend(entries)
        return statistics, ""


def rate(count: int, hours: float) -> float | None:
    """Per hour, None while there were too few hours to say."""
    return round(count / hours, 2) if hours >= ENOUGH_HOURS else None


def _per_hour(value: float | None) -> str:
    return "" if value is None else f" ({value:.1f} an hour)"


def _iso(wall: float) -> str | None:
    return datetime.fromtimestamp(wall, timezone.utc).isoformat(timespec="seconds") if wall else None


def _count(saved: Mapping[str, Any]) -> Count:
    figures = {
        name: _figure(saved.get(name, 0)) for name in ("holds", "ended", "seconds", "longest", "by_hand")
    }
    whole = {name: int(figures[name]) for name in ("holds", "ended", "by_hand")}
    return Count(seconds=figures["seconds"], longest=figures["longest"], **whole)


def _entry(saved: Mapping[str, Any]) -> Entry:
    reasons: Iterable[str] = saved["reasons"]
    lasted = None if saved["lasted"] is None else _figure(saved["lasted"])
    return Entry(
        int(_figure(saved["number"])),
        _figure(saved["at"]),
        [Reason(value).value for value in reasons],
        lasted,
        bool(saved["by_hand"]),
    )


def _figure(value: Any) -> float:
    """A finite number that is not negative; TypeError or ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    if not 0 <= value < _LARGEST:
        raise ValueError(f"{value} cannot be")
    return float(value)


WARNING, NOTICE = 4, 5
TEXT_GAP = 10.0
"""Seconds at least between two texts of would-be holds: their running numbers tell of those between."""
LOG_EVERY, TEXT_EVERY = 600.0, 1800.0
"""Seconds watched between two sums in the log, and to the operator."""


class ShadowReporter:
    """Writes the book, and tells of it within bounds."""

    def __init__(
        self,
        statistics: ShadowStatistics,
        calls: OperatorCalls,
        link: Link,
        picture: Callable[[Assessment, State, str], None],
    ) -> None:
        """picture: keeps a picture of a judged frame, with a title."""
        self._book = statistics
        self._calls = calls
        self._link = link
        self._picture = picture
        self._text_at = -math.inf
        self._logged = self._told = calls.shadow.watched

    def began(self, hold: WouldHold, now: float) -> None:
        """A would-be hold begins; the call has its own picture, where there is one."""
        self._book.began(hold, time.time())
        text = notices.would_hold(hold.number, sorted(reason.value for reason in hold.reasons))
        log.warning("shadow: %s", text)
        if now - self._text_at >= TEXT_GAP:
            self._text_at = now
            self._link.say(text, WARNING, now)
        newest = self._calls.reason_filter.newest
        if newest is not None and self._calls.call is None:
            self._picture(newest, self._calls.state(now), text)

    def ended(self, hold: WouldResume) -> None:
        """It is over."""
        self._book.ended(hold)
        how = "by hand" if hold.by_hand else "frames are OK"
        log.warning("shadow: S%d over after %.1f s: %s", hold.number, hold.lasted, how)

    def tick(self, now: float) -> None:
        """The sums, when they are due."""
        if self._calls.policy is not Policy.SHADOW:
            return
        shadow = self._calls.shadow
        if shadow.watched < self._told:
            self._logged = self._told = shadow.watched
        if shadow.watched - self._logged >= LOG_EVERY:
            self._logged = shadow.watched
            log.info("shadow: %s", self._book.line(shadow))
        if shadow.watched - self._told >= TEXT_EVERY:
            self._told = shadow.watched
            self._link.say(self._book.text(shadow), NOTICE, now)

    def last(self) -> None:
        """The daemon ends."""
        if self._calls.shadow.watched:
            log.info("shadow: %s", self._book.line(self._calls.shadow))
