"""`companion run`: puts the daemon together from the configuration, and runs it until SIGTERM."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from anytraverse.engine import AnyTraverse
from anytraverse.judging import Settings
from anytraverse.pace import Pace
from anytraverse.regions import Region
from companion.album import Album
from companion.calls.machine import OperatorCalls
from companion.cameras import Playback, open_camera
from companion.cameras.newest import CameraThread
from companion.check.stopping import Stopping
from companion.config import Config
from companion.configured import call_numbers, first_values, kept_values, restored_policies
from companion.conversation import Conversation
from companion.daemon import Daemon, stop_on_signals
from companion.eyes import Eyes
from companion.files.calls import CallFiles
from companion.files.offer import Offer
from companion.files.state import State as StateFile
from companion.frozen import is_moving
from companion.journal import Journal
from companion.keeper import Keeper
from companion.kept import Kept, saved_replies
from companion.link.link import Link
from companion.link.signing import Signing, open_signing
from companion.loading import load
from companion.logbook import logbook
from companion.model import Model
from companion.overrides import Overrides
from companion.readiness import get_ready
from companion.refusal import HoldJudge
from companion.restored import first_policy, open_book, open_id, restore_calls, whole
from companion.settings_desk import SettingsDesk
from companion.tasks import Liveness, tasks
from companion.wire import notices, parameters, texts
from companion.wire.ids import Policy, State
from companion.writer import Writer

log = logging.getLogger(__name__)

_STATUS_PERIOD = 1.0


def main(config: Config, stop: Callable[[], bool] | None = None) -> int:
    """Run until `stop()` (by default SIGTERM or SIGINT); the exit code.

    Raises AnyTraverseError, LinkError, ParameterError, JournalError for what a person must mend first.
    """
    stop = stop or stop_on_signals()
    with ExitStack() as closing:
        return _main(config, stop, closing)


def _main(config: Config, stop: Callable[[], bool], closing: ExitStack) -> int:
    listed = parameters.build(config.vocabulary, config.words, first_values(config), aliases=config.aliases)
    journal = Journal(config.journal.path)
    writer = closing.enter_context(Writer(journal))
    closing.enter_context(logbook(config.journal.path, writer))
    offer = Offer(config.journal.path)
    supervision = journal.load_supervision() or {}
    link = Link(config.link.settings(), listed, time.monotonic(), tree=offer.tree, signing=_signing(config))
    closing.callback(link.close)
    link.set_state(State.STARTING, open_id(supervision), first_policy(config, supervision))
    ready = load(partial(get_ready, config, journal.load_memory()), link, stop)
    if ready is None:
        return 0
    engine, news = ready.engine, list(ready.notices)
    if journal.recovered_from is not None:
        news.insert(0, f"journal was damaged, set aside as {journal.recovered_from.name}")
    overrides = _restore_settings(config, engine, supervision.get("settings"), news)
    now = time.monotonic()
    pace = Pace(ready.step, 1.0 / config.camera.rate, engine.settings.freshness)
    numbers = call_numbers(config, engine.settings)
    wants_hold = numbers.policy is Policy.HOLD
    hold_judge = HoldJudge(config, pace)
    if wants_hold and not _may_hold(hold_judge, engine.settings, news):
        numbers = replace(numbers, policy=Policy.REPORT)
    policies = restored_policies(config, numbers.policy, supervision.get("policy"), now)
    numbers = replace(numbers, policy=policies.in_force)
    calls = OperatorCalls(numbers, now)
    if supervision:
        restore_calls(calls, supervision, now, news)
    book = open_book(engine.perceiver.model_id, calls, supervision.get("shadow"), now, news)
    last_frame = whole(supervision.get("frame_id"))
    replies = saved_replies(supervision.get("replies"))
    keeper = _open_keeper(config, journal, writer, calls, offer, last_frame, replies)
    camera = _open_camera(config, last_frame + 1)
    closing.callback(camera.close)
    eyes = Eyes(engine, camera, pace.period)
    closing.callback(eyes.stop)
    conversation = Conversation(calls, eyes, engine.memory.preferences, replies)
    desk = SettingsDesk(
        listed,
        link,
        eyes,
        calls,
        conversation,
        hold_judge.refuses,
        overrides,
        wants_hold=wants_hold,
        policies=policies,
        book=book,
    )
    desk.start(now)
    model, view = Model.of(engine.perceiver), round(config.camera.view)
    daemon = Daemon(
        link, camera, eyes, calls, keeper, conversation, desk, Liveness(tasks(numbers), now), model, view
    )
    offer.show(
        StateFile(daemon.status, calls, conversation, desk, keeper, daemon.whereabouts).figures,
        lambda: calls.sight.newest,
    )
    eyes.place, eyes.moving = daemon.whereabouts.place, partial(is_moving, link, calls)
    if model.int8_idle and config.perceiver.precision == "auto":
        news.append(notices.int8_idle())
    _tell(news, link, now)
    log.info("perceiver: %s, %.0f ms a frame", model, 1e3 * pace.step)
    log.info("ready: camera %s, policy %s", config.camera.source, numbers.policy.name.lower())
    eyes.start()
    keeper.restore_call_frame(calls, eyes)
    _run(daemon, keeper, stop)
    return 0


def _tell(news: Iterable[str], link: Link, now: float) -> None:
    for notice in news:
        log.warning("%s", notice)
        link.say(texts.fit(notice), 4, now)


def _restore_settings(config: Config, engine: AnyTraverse, saved: Any, news: list[str]) -> Overrides:
    """What the ground set before the restart, as far as it still counts, is how frames are judged."""
    overrides = Overrides(kept_values(config, engine.settings), engine.perceiver.model_id)
    left_out = overrides.restore(saved)
    engine.settings, misfits = overrides.tuned(engine.settings)
    news += [*left_out, *misfits]
    if overrides.values:
        log.warning("set by the ground, not as in the file: %s", overrides.figures())
    return overrides


def _may_hold(hold_judge: HoldJudge, judging: Settings, news: list[str]) -> bool:
    """Whether the vehicle may be held, as its owner wants; told is why not, or what nobody could check."""
    refusal, stopping = hold_judge.refuses(judging), hold_judge.stopping(judging)
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
    calls: OperatorCalls,
    offer: Offer,
    last_frame: int,
    replies: Sequence[Kept],
) -> Keeper:
    def region() -> Region:
        return calls.numbers.judging.region

    folder = config.journal.path
    album, files = Album(folder / "pictures", config.pictures.keep), CallFiles(offer.calls)
    return Keeper(journal, writer, album, files, folder / "status.json", region, last_frame, replies)


def _open_camera(config: Config, first_id: int) -> CameraThread:
    source, playback = config.camera.source, Playback(config.camera.playback, config.camera.loop)
    return CameraThread(partial(open_camera, source, playback), first_id=first_id)


def _run(daemon: Daemon, keeper: Keeper, stop: Callable[[], bool]) -> None:
    status_at = float("-inf")
    try:
        while not stop():
            daemon.turn()
            if time.monotonic() - status_at >= _STATUS_PERIOD:
                status_at = time.monotonic()
                keeper.write_status(daemon.status())
    except Exception:
        log.critical("the supervision failed: the companion stops")
        daemon.farewell()
        raise
    daemon.leave()
    keeper.leave(daemon.status())
