"""The daemon put together, for `companion run`, tests and benches alike, and what a restart takes up."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from anytraverse.judging import Settings
from anytraverse.memory import Memory
from anytraverse.pace import Pace
from companion.answers.handler import AnswerHandler
from companion.answers.store import AnswerStore
from companion.calls.machine import OperatorCalls
from companion.calls.numbers import Numbers
from companion.calls.snapshot import restore
from companion.config import Config
from companion.daemon.daemon import Daemon
from companion.daemon.persistence import Persistence
from companion.link.link import Link
from companion.policy.hold_gate import HoldGate
from companion.policy.service import PolicyService
from companion.policy.shadow import ShadowStatistics
from companion.policy.stopping import Stopping
from companion.settings.mapping import call_numbers, first_values, first_words, kept_values, restored_policies
from companion.settings.runtime import RuntimeSettings
from companion.settings.service import SettingsService
from companion.storage import Journal
from companion.storage.call_files import CallFiles, PictureArchive
from companion.storage.served_files import ServedFiles
from companion.storage.writer import SLOW, Writer
from companion.vehicle.state import VehiclePosition
from companion.vision.client import Vision
from companion.vision.messages import Ready
from companion.wire import notices
from companion.wire.ids import Policy
from companion.wire.parameters import POLICY, Parameter, build

log = logging.getLogger(__name__)

_U32 = 0xFFFFFFFF


class Opened(NamedTuple):
    """What a daemon stands on; whoever opened it closes it. saved: what the journal kept of the last run."""

    link: Link
    vision: Vision
    journal: Journal
    writer: Writer
    served: ServedFiles
    saved: Mapping[str, Any]


def compose(
    config: Config,
    opened: Opened,
    ready: Ready,
    news: list[str],
    *,
    state_machine: Callable[[Numbers, float], OperatorCalls] = OperatorCalls,
) -> Daemon:
    """The daemon, once vision is ready. news: what a person should be told is added to it."""
    link, vision, journal, writer, served, saved = opened
    link.set_undecided_for(vision.answers_within + SLOW)
    model, now, folder = ready.model, time.monotonic(), config.journal.path
    if journal.recovered_from is not None:
        news.insert(0, f"journal was damaged, set aside as {journal.recovered_from.name}")
    overrides, judging = restore_settings(config, ready, saved.get("settings"), news)
    numbers = call_numbers(config, judging)
    wants_hold = numbers.policy is Policy.HOLD
    hold_gate = HoldGate(config, Pace(ready.step, 1.0 / config.camera.rate, judging.freshness))
    if wants_hold and not _may_hold(hold_gate, judging, news):
        numbers = replace(numbers, policy=Policy.REPORT)
    policies = restored_policies(config, numbers.policy, saved.get("policy"), now)
    calls = state_machine(replace(numbers, policy=policies.in_force), now)
    if saved:
        restore_calls(calls, saved, now, news)
    statistics = open_book(model.id, calls, saved.get("shadow"), now, news)
    replies = AnswerStore(saved.get("replies"))
    position = VehiclePosition(lambda: link.vehicle)
    persistence = Persistence(
        journal,
        writer,
        PictureArchive(folder / "pictures", config.pictures.keep),
        CallFiles(served.calls),
        vision,
        folder / "status.json",
        position.clock.stamp,
        replies,
        whole(saved.get("frame_id")),
    )
    answer_handler = AnswerHandler(calls, vision, vision.memory.preferences, replies)
    keep = persistence.when_kept
    policy = PolicyService(link, calls, policies, keep, refuses=hold_gate.refuses, wants_hold=wants_hold)
    listed = build(config.vocabulary, config.words, first_values(config), aliases=config.aliases)
    settings = SettingsService(
        listed, link, vision, calls, answer_handler, policy, overrides, statistics, keep
    )
    settings.start(now)
    view = round(config.camera.view)
    daemon = Daemon(link, vision, calls, persistence, answer_handler, settings, position, model, view=view)
    served.show(daemon.state_file, lambda: calls.reason_filter.newest)
    vision.tune(judging)
    persistence.restore_call_frame(calls)
    return daemon


def restore_settings(
    config: Config, ready: Ready, saved: Any, news: list[str]
) -> tuple[RuntimeSettings, Settings]:
    """What the ground set before the restart, as far as it still counts, is how frames are judged."""
    overrides = RuntimeSettings(kept_values(config, ready.settings), ready.model.id)
    left_out = overrides.restore(saved)
    judging, misfits = overrides.tuned(ready.settings)
    news += [*left_out, *misfits]
    if overrides.values:
        log.warning("set by the ground, not as in the file: %s", overrides.figures())
    return overrides, judging


def _may_hold(hold_gate: HoldGate, judging: Settings, news: list[str]) -> bool:
    """Whether the vehicle may be held, as its owner wants; told is why not, or what nobody could check."""
    refusal, stopping = hold_gate.refuses(judging), hold_gate.stopping(judging)
    if refusal is not None:
        log.error("%s", refusal.why)
    elif isinstance(stopping, Stopping):
        log.info("stopping: %s", stopping.told())
    else:
        log.warning("stopping distance was not checked: %s", stopping)
        news.append(notices.stopping_unchecked())
    return refusal is None


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
    statistics, notice = ShadowStatistics.restored(saved, calls.shadow, model, now, time.time())
    if notice:
        log.warning("%s", notice)
        news.append(notice)
    if calls.policy is not Policy.SHADOW:
        for over in calls.shadow.leave(now):
            statistics.ended(over)
    return statistics
