"""`companion run`: puts the daemon together from the configuration, and runs it until SIGTERM."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from typing import Any

from anytraverse.engine import AnyTraverse
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import Memory, first_memory, resumed_memory
from anytraverse.perception import Perceiver, make_perceiver
from anytraverse.regions import Box
from anytraverse.roi import Corridor
from companion.album import Album
from companion.calls.machine import OperatorCalls
from companion.calls.numbers import Numbers
from companion.calls.snapshot import restore
from companion.cameras import Playback, open_camera
from companion.cameras.newest import CameraThread
from companion.config import Config
from companion.conversation import Conversation
from companion.daemon import Daemon, stop_on_signals
from companion.eyes import Eyes
from companion.journal import Journal
from companion.keeper import Keeper
from companion.kept import saved_replies
from companion.link.link import Link
from companion.loading import load_perceiver
from companion.settings_desk import SettingsDesk, setting_values
from companion.tasks import Liveness, tasks
from companion.wire import parameters, texts
from companion.wire.ids import Policy, State

log = logging.getLogger(__name__)

_STATUS_PERIOD = 1.0
_U32 = 0xFFFFFFFF


def judging_settings(config: Config, perceiver: Perceiver) -> Settings:
    """How frames are judged: the config's figures, and the perceiver's own where it leaves them open."""
    given, own = config.thresholds, Thresholds.of(perceiver.defaults)
    tile = own.tile if given.tile is None else None if given.tile == "off" else float(given.tile)
    thresholds = Thresholds(
        roi=own.roi if given.roi is None else given.roi,
        scene=own.scene if given.scene is None else given.scene,
        tile=tile,
        trav=given.trav,
        margin=config.call.margin,
        similarity_margin=config.call.similarity_margin,
    )
    roi = config.roi
    return Settings(
        region=Box(roi.left, roi.top, roi.right, roi.bottom),
        thresholds=thresholds,
        corridor=Corridor(config.corridor.bottom, config.corridor.top),
        tile_share=roi.tile_share,
        freshness=config.freshness,
        votes=config.call.votes,
        window=config.call.window,
    )


def call_numbers(config: Config, judging: Settings) -> Numbers:
    """The state machine's table of numbers."""
    call = config.call
    return Numbers(
        policy=Policy[call.policy.upper()],
        judging=judging,
        votes=call.votes,
        window=call.window,
        ok_frames=call.ok_frames,
        passed_after=call.passed_after,
        accepted_for=call.accepted_for,
        accepted_distance=call.accepted_distance,
        accepted_rise=call.accepted_rise,
        go_lasts=call.go_lasts,
        fault_ends_hold=call.fault_ends_hold,
    )


def main(config: Config, stop: Callable[[], bool] | None = None) -> int:
    """Run until `stop()` (by default SIGTERM or SIGINT); the exit code.

    Raises AnyTraverseError, LinkError, ParameterError, JournalError for what a person must mend first.
    """
    stop = stop or stop_on_signals()
    with ExitStack() as closing:
        return _main(config, stop, closing)


def _main(config: Config, stop: Callable[[], bool], closing: ExitStack) -> int:
    words = config.preferences
    vocabulary = tuple(dict.fromkeys((*words, *config.vocabulary)))
    listed = parameters.build(vocabulary, words, {}, aliases=config.aliases)
    journal = Journal(config.journal.path)
    closing.callback(journal.close)
    supervision = journal.load_supervision() or {}
    link = Link(config.link.settings(), listed, time.monotonic())
    closing.callback(link.close)
    link.set_state(State.STARTING, open_id(supervision))
    perceiver = load_perceiver(partial(make_perceiver, config.perceiver.name), link, stop)
    if perceiver is None:
        return 0
    judging = judging_settings(config, perceiver)
    memory, notices = _remembered(journal, config, perceiver)
    engine = AnyTraverse(perceiver, judging, memory)
    now = time.monotonic()
    numbers = call_numbers(config, judging)
    calls = OperatorCalls(numbers, now)
    if supervision:
        _restore(calls, supervision, now, notices)
    last_frame = _whole(supervision.get("frame_id"))
    replies = saved_replies(supervision.get("replies"))
    folder = config.journal.path
    album = Album(folder / "pictures", config.pictures.keep, judging.region)
    keeper = Keeper(journal, album, folder / "status.json", last_frame, replies)
    source, playback = config.camera.source, Playback(config.camera.playback, config.camera.loop)
    camera = CameraThread(partial(open_camera, source, playback), first_id=last_frame + 1)
    closing.callback(camera.close)
    eyes = Eyes(engine, camera, 1.0 / config.camera.rate)
    closing.callback(eyes.stop)
    conversation = Conversation(calls, eyes, memory.preferences, replies)
    desk = SettingsDesk(listed, link, eyes, calls, conversation)
    for name, value in setting_values(judging.thresholds, numbers.policy).items():
        link.set_parameter(name, value, now)
    liveness = Liveness(tasks(numbers), now)
    view = round(config.camera.view)
    daemon = Daemon(link, camera, eyes, calls, keeper, conversation, desk, liveness, view)
    eyes.place = daemon.place
    for notice in notices:
        log.warning("%s", notice)
        link.say(texts.fit(notice), 4, now)
    log.info(
        "ready: %s, camera %s, link %s, policy %s",
        perceiver.model_id,
        source,
        config.link.url,
        config.call.policy,
    )
    eyes.start()
    keeper.restore_call_frame(calls, eyes)
    _run(daemon, keeper, stop)
    return 0


def _remembered(journal: Journal, config: Config, perceiver: Perceiver) -> tuple[Memory, list[str]]:
    """What the journal holds, fitted to model and config, and what a person should be told about it."""
    notices: list[str] = []
    if journal.recovered_from is not None:
        notices.append(f"journal was damaged, set aside as {journal.recovered_from.name}")
    saved = journal.load_memory()
    if saved is None:
        return first_memory(perceiver.model_id, config.preferences, config.journal.scenes), notices
    memory, told = resumed_memory(
        saved,
        perceiver.model_id,
        config.preferences,
        perceiver.meaning,
        history_limit=config.journal.scenes,
    )
    return memory, notices + told


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
    keeper.write_status(daemon.status(), last=True)


def open_id(saved: Mapping[str, Any]) -> int:
    """The call or hold that was open: told from the first heartbeat on, so that nobody thinks it closed."""
    open_one = saved.get("call") or saved.get("hold")
    return _whole(open_one.get("id")) if isinstance(open_one, dict) else 0


def _whole(value: Any) -> int:
    return value if isinstance(value, int) and 0 <= value <= _U32 else 0


def _restore(calls: OperatorCalls, saved: Mapping[str, Any], now: float, notices: list[str]) -> None:
    calls.last_id = _whole(saved.get("last_id")) & 0xFFFF
    try:
        restore(calls, saved, now)
    except (KeyError, TypeError, ValueError) as error:
        notices.append(f"open call not restored: {error!r}")
    if calls.current_id:
        log.warning("restarted with %s %d open", calls.kind.name.lower(), calls.current_id)
