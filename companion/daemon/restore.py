"""What a restart takes up: counts, ids, the open call and the hold, from what the journal kept."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from typing import Any

from anytraverse.memory import Memory
from companion.calls.machine import OperatorCalls
from companion.calls.snapshot import restore
from companion.config import Config
from companion.policy.shadow import ShadowStatistics
from companion.settings.mapping import first_values, first_words, restored_policies
from companion.wire.ids import Policy
from companion.wire.parameters import POLICY, Parameter, build

log = logging.getLogger(__name__)

_U32 = 0xFFFFFFFF


def first_policy(config: Config, saved: Mapping[str, Any]) -> Policy:
    """What will be in force unless holding is refused: the autopilot's script goes by it from the start."""
    configured = Policy[config.call.policy.upper()]
    return restored_policies(config, configured, saved.get("policy"), time.monotonic()).in_force


def first_parameters(
    config: Config, memory: Memory | None, saved: Mapping[str, Any]
) -> tuple[Parameter, ...]:
    """The parameters as they were before the restart, for the time until the perceiver is loaded."""
    words = first_words(config, memory)
    offered = {word: words[word] for word in config.vocabulary if word in words}
    values = {**first_values(config, saved.get("settings")), POLICY: float(first_policy(config, saved))}
    return build(config.vocabulary, offered, values, aliases=config.aliases)


def open_id(saved: Mapping[str, Any]) -> int:
    """The call or hold that was open: told from the first heartbeat on, so that nobody thinks it closed."""
    open_one = saved.get("call") or saved.get("hold")
    return whole(open_one.get("id")) if isinstance(open_one, dict) else 0


def whole(value: Any) -> int:
    """A number of 32 bits as it was kept, 0 for anything else."""
    return value if isinstance(value, int) and 0 <= value <= _U32 else 0


def restore_calls(calls: OperatorCalls, saved: Mapping[str, Any], now: float, news: list[str]) -> None:
    """Call, hold and the counter go on as they were left; what cannot be read is told."""
    calls.last_id = whole(saved.get("last_id")) & 0xFFFF
    try:
        restore(calls, saved, now)
    except (KeyError, TypeError, ValueError) as error:
        news.append(f"open call not restored: {error!r}")
    if calls.current_id:
        log.warning("restarted with %s %d open", calls.kind.name.lower(), calls.current_id)


def open_book(model: str, calls: OperatorCalls, saved: Any, now: float, news: list[str]) -> ShadowStatistics:
    """The counts of shadow policy as they were left; what stood under another policy stands no more."""
    book, notice = ShadowStatistics.restored(saved, calls.shadow, model, now, time.time())
    if notice:
        log.warning("%s", notice)
        news.append(notice)
    if calls.policy is not Policy.SHADOW:
        for over in calls.shadow.leave(now):
            book.ended(over)
    return book
