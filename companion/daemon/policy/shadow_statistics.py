"""Keeps the statistics of the shadow policy's would-be holds, and reports them at limited rates."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from typing import Any

from anytraverse.assessment import Reason
from companion.calls.decisions import WouldHold, WouldResume
from companion.calls.policy import Shadow
from companion.daemon.turn import Decided, Event, Observer, Turn
from companion.link.alerts import TextSender
from companion.wire import notices
from companion.wire.ids import NOTICE, WARNING, Policy
from companion.wire.parameters import MANY, SHADOW_HOLDS, SHADOW_HOURS, SHADOW_REASONS

ENOUGH_HOURS = 0.1
"""Hours that must have been watched before a rate is given."""
_STORED_ENTRIES = 50
_SAVE_EVERY = 60.0
"""Seconds watched between two saves of the counter, which a kill may cost: saves wear out an SD card."""
_LARGEST = 1e11
"""Upper limit of a saved figure: as a Unix time it is a year that `datetime` can still represent."""
_REASONS = tuple(reason.value for reason in Reason)
log = logging.getLogger(__name__)
TEXT_GAP = 10.0
"""Least seconds between two texts about would-be holds. Their running numbers show how many were skipped."""
LOG_EVERY, TEXT_EVERY = 600.0, 1800.0
"""Seconds watched between two totals in the log, and to the operator."""


@dataclass
class Count:
    """The would-be holds that began for one reason. One that began for two reasons counts under both.

    holds: all that began. ended, seconds, longest: number, total and longest duration (s) of those that OK
    frames ended. by_hand: those that a human ended; their duration says nothing.
    """

    holds: int = 0
    ended: int = 0
    seconds: float = 0.0
    longest: float = 0.0
    by_hand: int = 0

    def end(self, lasted: float, *, by_hand: bool) -> None:
        """Count the end of a would-be hold that lasted `lasted` seconds."""
        if by_hand:
            self.by_hand += 1
        else:
            self.ended, self.seconds = self.ended + 1, self.seconds + lasted
            self.longest = max(self.longest, lasted)


@dataclass
class _Entry:
    """One would-be hold. at: Unix time of its beginning. lasted: seconds, None until it ends."""

    number: int
    at: float
    reasons: list[str]
    lasted: float | None = None
    by_hand: bool = False


@dataclass
class ShadowStatistics:
    """Counts would-be holds by reason. Counts survive a restart; another model or a request resets them.

    shadow: the number of all, and for how long it was watched. model: id of the perceiver's model. since:
    Unix time from which on it counts. newest: the last 50.
    """

    shadow: Shadow
    model: str = ""
    since: float = 0.0
    counts: dict[str, Count] = field(default_factory=lambda: {name: Count() for name in _REASONS})
    newest: deque[_Entry] = field(default_factory=lambda: deque(maxlen=_STORED_ENTRIES))
    _saved: dict[str, Any] | None = None

    def began(self, hold: WouldHold, wall: float) -> None:
        """Record the begin of a would-be hold at Unix time `wall`."""
        self._saved = None
        reasons = sorted(reason.value for reason in hold.reasons)
        self.newest.append(_Entry(hold.number, wall, reasons))
        for name in reasons:
            self.counts[name].holds += 1

    def ended(self, hold: WouldResume) -> None:
        """Record the end of a would-be hold."""
        self._saved = None
        for reason in hold.reasons:
            self.counts[reason.value].end(hold.lasted, by_hand=hold.by_hand)
        if self.newest and self.newest[-1].number == hold.number:
            self.newest[-1].lasted, self.newest[-1].by_hand = round(hold.lasted, 2), hold.by_hand

    def figures(self) -> dict[str, Any]:
        """Return the shadow policy's part of the status file. per_hour is null in the first six minutes."""
        hours = self.shadow.watched / 3600
        return {
            "since": _iso(self.since),
            "watched_hours": round(hours, 4),
            "would_hold": self.shadow.count,
            "per_hour": rate(self.shadow.count, hours),
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
            "standing": sorted(reason.value for reason in self.shadow.open),
            "newest": [{**asdict(entry), "at": _iso(entry.at)} for entry in reversed(self.newest)],
        }

    def line(self) -> str:
        """Return all counts on one line, for the log."""
        hours = self.shadow.watched / 3600
        parts = [
            f"{name} {count.holds}{_per_hour(rate(count.holds, hours))}"
            + (
                f", mean {count.seconds / count.ended:.1f} s, longest {count.longest:.1f} s"
                * bool(count.ended)
            )
            for name, count in self.counts.items()
            if count.holds
        ]
        count = self.shadow.count
        total = f"{count} would-be holds in {hours:.2f} h{_per_hour(rate(count, hours))}"
        return "; ".join([total, *parts])

    def text(self) -> str:
        """Return the counts as a STATUSTEXT."""
        hours = self.shadow.watched / 3600
        most = max(self.counts, key=lambda name: self.counts[name].holds) if self.shadow.count else ""
        return notices.shadow_so_far(self.shadow.count, hours, most)

    def values(self) -> dict[str, float]:
        """Return the counts as parameters, name -> value. Hours are in tenths, so that they seldom change."""
        counts = {SHADOW_REASONS[name]: float(count.holds) for name, count in self.counts.items()}
        hours = math.floor(self.shadow.watched / 360) / 10
        values = {SHADOW_HOLDS: float(self.shadow.count), SHADOW_HOURS: hours} | counts
        return {name: min(value, MANY) for name, value in values.items()}

    def reset(self, wall: float) -> None:
        """Reset all counts. wall: the Unix time now."""
        self.shadow.reset()
        self.since, self._saved = wall, None
        self.counts = {name: Count() for name in _REASONS}
        self.newest.clear()

    def saved(self, now: float) -> dict[str, Any]:
        """Return the counts as JSON values for the journal.

        The same object is returned until there is a change worth a write.
        """
        if self._saved is None or abs(self.shadow.watched - self._saved["watched"]) >= _SAVE_EVERY:
            self._saved = {
                "model": self.model,
                "since": self.since,
                "count": self.shadow.count,
                "watched": self.shadow.watched,
                "open": sorted(reason.value for reason in self.shadow.open),
                "lasted": now - self.shadow.began_at if self.shadow.open else 0.0,
                "counts": {name: asdict(count) for name, count in self.counts.items()},
                "newest": [asdict(entry) for entry in self.newest],
            }
        return self._saved

    @classmethod
    def restored(
        cls, saved: Any, shadow: Shadow, model: str, now: float, wall: float
    ) -> tuple[ShadowStatistics, str]:
        """Restore statistics and `shadow` from what `saved` returned. Returns the statistics and a notice.

        The notice is "" unless the counts had to be reset. now: monotonic seconds. wall: the Unix time now.
        """
        statistics = cls(shadow, model=model, since=wall)
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
    """Return the count per hour, None before `ENOUGH_HOURS` were watched."""
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


def _entry(saved: Mapping[str, Any]) -> _Entry:
    reasons: Iterable[str] = saved["reasons"]
    lasted = None if saved["lasted"] is None else _figure(saved["lasted"])
    return _Entry(
        int(_figure(saved["number"])),
        _figure(saved["at"]),
        [Reason(value).value for value in reasons],
        lasted,
        bool(saved["by_hand"]),
    )


def _figure(value: Any) -> float:
    """Return a finite number that is not negative. Raises TypeError or ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    if not 0 <= value < _LARGEST:
        raise ValueError(f"{value} cannot be")
    return float(value)


class ShadowReporter(Observer):
    """Observes would-be holds, and reports them and the totals at limited rates."""

    def __init__(self, statistics: ShadowStatistics, sender: TextSender) -> None:
        self._statistics = statistics
        self._sender = sender
        self._text_at = -math.inf
        self._watched_at_log = self._watched_at_text = statistics.shadow.watched

    def happened(self, event: Event, turn: Turn) -> None:
        """Report would-be holds."""
        match event:
            case Decided(WouldHold() as hold):
                self._began(hold, turn.now)
            case Decided(WouldResume() as hold):
                self._ended(hold)

    def see(self, turn: Turn) -> None:
        """Report the totals when they are due."""
        if turn.policy is Policy.SHADOW:
            self._report_totals(turn.now)

    def _began(self, hold: WouldHold, now: float) -> None:
        text = notices.would_hold(hold.number, sorted(reason.value for reason in hold.reasons))
        log.warning("shadow: %s", text)
        if now - self._text_at >= TEXT_GAP:
            self._text_at = now
            self._sender.send(text, WARNING, now)

    def _ended(self, hold: WouldResume) -> None:
        how = "by hand" if hold.by_hand else "frames are OK"
        log.warning("shadow: S%d over after %.1f s: %s", hold.number, hold.lasted, how)

    def _report_totals(self, now: float) -> None:
        shadow = self._statistics.shadow
        # The counts were reset.
        if shadow.watched < self._watched_at_text:
            self._watched_at_log = self._watched_at_text = shadow.watched
        if shadow.watched - self._watched_at_log >= LOG_EVERY:
            self._watched_at_log = shadow.watched
            log.info("shadow: %s", self._statistics.line())
        if shadow.watched - self._watched_at_text >= TEXT_EVERY:
            self._watched_at_text = shadow.watched
            self._sender.send(self._statistics.text(), NOTICE, now)

    def log_totals(self) -> None:
        """Log the totals at the daemon's end."""
        if self._statistics.shadow.watched:
            log.info("shadow: %s", self._statistics.line())
