"""`companion run`: puts the daemon together from the configuration, and runs it until SIGTERM."""

from __future__ import annotations

import gc
import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from anytraverse.judging import Settings
from anytraverse.memory import Memory
from anytraverse.pace import Pace
from companion.answers.handler import AnswerHandler
from companion.answers.store import StoredReply, read_replies
from companion.calls.machine import OperatorCalls
from companion.config import Config
from companion.daemon.daemon import Daemon, stop_on_signals
from companion.daemon.persistence import Persistence
from companion.daemon.restore import first_parameters, first_policy, open_book, open_id, restore_calls, whole
from companion.daemon.startup import load
from companion.daemon.status import State as StateFile
from companion.link.link import Link
from companion.link.signing import Signing, open_signing
from companion.policy.hold_gate import HoldGate, require_checkable
from companion.policy.stopping import Stopping
from companion.settings.mapping import call_numbers, first_values, first_words, kept_values, restored_policies
from companion.settings.runtime import RuntimeSettings
from companion.settings.service import SettingsService
from companion.storage import Journal
from companion.storage.call_files import CallFiles, PictureArchive
from companion.storage.file_reader import Reader
from companion.storage.log_file import logbook
from companion.storage.served_files import ServedFiles
from companion.storage.writer import SLOW, Writer
from companion.tasks import VISION, Liveness, tasks
from companion.vision.child import COMMAND, VisionChild
from companion.vision.client import Vision
from companion.vision.messages import Ready
from companion.wire import notices, parameters, texts
from companion.wire.ids import Policy, State

log = logging.getLogger(__name__)

_STATUS_PERIOD = 1.0


def main(config: Config, stop: Callable[[], bool] | None = None, vision: Sequence[str] | None = None) -> int:
    """Run until `stop()` (by default SIGTERM or SIGINT); the exit code.

    vision: the command of the vision process, for one that knows other perceivers.
    Raises AnyTraverseError, LinkError, ParameterError, JournalError for what a person must mend first.
    """
    require_checkable(config)
    stop = stop or stop_on_signals()
    with ExitStack() as closing:
        code = _main(config, stop, vision or COMMAND, closing)
        log.info("told to stop, and stopped")
        return code


def _main(config: Config, stop: Callable[[], bool], command: Sequence[str], closing: ExitStack) -> int:
    listed = parameters.build(config.vocabulary, config.words, first_values(config), aliases=config.aliases)
    journal = Journal(config.journal.path)
    writer = closing.enter_context(Writer(journal))
    closing.enter_context(logbook(config.journal.path, writer))
    offer = ServedFiles(config.journal.path, closing.enter_context(Reader()))
    memory, supervision = journal.load_memory(), journal.load_supervision() or {}
    gc.freeze()  # what is remembered stays: to look through 10,000 scenes would stall the loop
    link = _open_link(config, offer, memory, supervision)
    closing.callback(link.close)
    last_frame = whole(supervision.get("frame_id"))
    vision = Vision(partial(VisionChild, command), config, memory, VISION, first_frame=last_frame + 1)
    closing.callback(vision.close)
    ready = load(vision, link, stop)
    if ready is None:
        return 0
    link.set_undecided_for(vision.answers_within + SLOW)
    model, news = ready.model, list(ready.notices)
    if journal.recovered_from is not None:
        news.insert(0, f"journal was damaged, set aside as {journal.recovered_from.name}")
    overrides, judging = _restore_settings(config, ready, supervision.get("settings"), news)
    now = time.monotonic()
    pace = Pace(ready.step, 1.0 / config.camera.rate, judging.freshness)
    numbers = call_numbers(config, judging)
    wants_hold = numbers.policy is Policy.HOLD
    hold_gate = HoldGate(config, pace)
    if wants_hold and not _may_hold(hold_gate, judging, news):
        numbers = replace(numbers, policy=Policy.REPORT)
    policies = restored_policies(config, numbers.policy, supervision.get("policy"), now)
    numbers = replace(numbers, policy=policies.in_force)
    calls = OperatorCalls(numbers, now)
    if supervision:
        restore_calls(calls, supervision, now, news)
    book = open_book(model.id, calls, supervision.get("shadow"), now, news)
    replies = read_replies(supervision.get("replies"))
    persistence = _open_keeper(config, journal, writer, vision, offer, last_frame, replies)
    answer_handler = AnswerHandler(calls, vision, vision.memory.preferences, replies)
    desk = SettingsService(
        listed,
        link,
        vision,
        calls,
        answer_handler,
        hold_gate.refuses,
        overrides,
        wants_hold=wants_hold,
        policies=policies,
        book=book,
    )
    desk.start(now)
    liveness, view = Liveness(tasks(numbers), now), round(config.camera.view)
    daemon = Daemon(link, vision, calls, persistence, answer_handler, desk, liveness, model, view)
    offer.show(
        StateFile(daemon.status, calls, answer_handler, desk, persistence, daemon.whereabouts).figures,
        lambda: calls.sight.newest,
    )
    if model.int8_idle and config.perceiver.precision == "auto":
        news.append(notices.int8_idle())
    _tell(news, link, now)
    log.info("perceiver: %s, %.0f ms a frame", model, 1e3 * pace.step)
    log.info("ready: policy %s", numbers.policy.name.lower())
    vision.tune(judging)
    persistence.restore_call_frame(calls)
    _run(daemon, persistence, stop)
    return 0


def _open_link(config: Config, offer: ServedFiles, memory: Memory | None, saved: Mapping[str, Any]) -> Link:
    """It tells from the first moment what was in force before the restart."""
    first = first_parameters(config, memory, saved)
    link = Link(config.link.settings(), first, time.monotonic(), tree=offer.tree, signing=_signing(config))
    link.set_words(first_words(config, memory))
    link.set_state(State.STARTING, open_id(saved), first_policy(config, saved))
    return link


def _tell(news: Iterable[str], link: Link, now: float) -> None:
    for notice in news:
        log.warning("%s", notice)
        link.say(texts.fit(notice), 4, now)


def _restore_settings(
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


def _signing(config: Config) -> Signing | None:
    if config.link.signing_key is None:
        return None
    key, exempt = Path(config.link.signing_key), config.link.unsigned_autopilot
    return open_signing(key, config.journal.path, unsigned_autopilot=exempt)


def _open_keeper(
    config: Config,
    journal: Journal,
    writer: Writer,
    vision: Vision,
    offer: ServedFiles,
    last_frame: int,
    replies: Sequence[StoredReply],
) -> Persistence:
    folder = config.journal.path
    album, files = PictureArchive(folder / "pictures", config.pictures.keep), CallFiles(offer.calls)
    status = folder / "status.json"
    return Persistence(journal, writer, album, files, vision, status, last_frame, replies)


def _run(daemon: Daemon, persistence: Persistence, stop: Callable[[], bool]) -> None:
    status_at = float("-inf")
    try:
        while not stop():
            daemon.turn()
            if time.monotonic() - status_at >= _STATUS_PERIOD:
                status_at = time.monotonic()
                persistence.write_status(daemon.status())
    except Exception:
        log.critical("the supervision failed: the companion stops")
        daemon.farewell()
        raise
    daemon.leave()
    persistence.leave(daemon.status())
