"""Implements `companion run`: makes the daemon from the configuration, and runs it until SIGTERM."""

from __future__ import annotations

import gc
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.memory import Memory
from companion.config import Config
from companion.daemon.composition import (
    Resources,
    compose,
    first_parameters,
    open_id,
    stored_u32,
)
from companion.daemon.daemon import Daemon
from companion.daemon.death import report_death
from companion.daemon.settings.mapping import first_words, restored_policy
from companion.daemon.startup import load
from companion.desk.check.report import EVERY, CheckReport
from companion.link.answer_store import AnswerStore
from companion.link.link import Link
from companion.link.signing import Signing, open_signing
from companion.observers.live.live import Live
from companion.observers.page.page import Page
from companion.observers.recording.packer import IncidentPacker
from companion.observers.recording.recorder import Recorder
from companion.observers.video.video import Video
from companion.storage import Journal
from companion.storage.file_reader import Reader
from companion.storage.log_file import log_to_file
from companion.storage.served_files import ServedFiles
from companion.storage.writer import Writer
from companion.system.background import BackgroundJob
from companion.system.service_manager import ServiceManager, stop_on_signals
from companion.tasks import VISION
from companion.vision.child import COMMAND, VisionChild
from companion.vision.client import VisionClient
from companion.vision.network_limit import needs_of
from companion.wire import notices, texts
from companion.wire.ids import WARNING, State

log = logging.getLogger(__name__)

_STATUS_PERIOD = 1.0


class _Beside(NamedTuple):
    """The supervisor's ends of the processes beside vision. Nothing waits for them."""

    page: Page
    video: Video
    recorder: Recorder
    live: Live
    packer: IncidentPacker

    @classmethod
    def of(cls, config: Config) -> _Beside:
        return cls(Page(config), Video(config), Recorder(config), Live(config), IncidentPacker(config))


def main(
    config: Config,
    stop: Callable[[], bool] | None = None,
    vision: Sequence[str] | None = None,
    service: ServiceManager | None = None,
) -> int:
    """Run the daemon until `stop()` is true (by default: on SIGTERM or SIGINT), and return the exit code.

    vision: the command line of the vision process, for one that has other perceivers. service: where systemd
    is told how it goes.
    Raises AnyTraverseError, LinkError, ParameterError or JournalError for what a person must mend first.
    """
    stop = stop or stop_on_signals()
    with ExitStack() as closing:
        service = service or ServiceManager()
        code = _main(config, stop, vision or COMMAND, service, closing)
        log.info("told to stop, and stopped")
        return code


def _main(
    config: Config,
    stop: Callable[[], bool],
    command: Sequence[str],
    service: ServiceManager,
    closing: ExitStack,
) -> int:
    journal = Journal(config.journal.path)
    writer = closing.enter_context(Writer(journal))
    closing.enter_context(log_to_file(config.journal.path, writer))
    served = ServedFiles(config.journal.path, closing.enter_context(Reader()))
    memory, saved = journal.load_memory(), journal.load_supervision() or {}
    # The memory lives as long as the daemon, and a full collection over all its scenes would stall the loop.
    gc.freeze()
    link = _open_link(config, served, memory, saved)
    closing.callback(link.close)
    first_frame = stored_u32(saved.get("frame_id")) + 1
    launch = partial(VisionChild, command, network=needs_of(config.camera.source).any)
    vision = VisionClient(launch, config, memory, VISION, first_frame=first_frame)
    closing.callback(vision.close)
    beside = _Beside.of(config)
    for process in beside:
        closing.callback(process.close)
    served.show_incidents(beside.packer.document)
    link.answers.to_page = beside.page.acknowledge
    beside.page.answer = link.answers.receive_from_page

    def poll(now: float) -> None:
        beside.page.tell(now, _starting)
        beside.video.poll(now)
        beside.recorder.feed(now)
        beside.live.feed(now)
        link.camera.url = beside.video.url

    ready = load(vision, link, stop, service, poll)
    if ready is None:
        service.stopping()
        return 0
    start_notices = list(ready.notices)
    daemon = compose(config, Resources(link, vision, journal, writer, served, saved), ready, start_notices)
    if ready.model.int8_idle and config.perceiver.precision == "auto":
        start_notices.append(notices.int8_idle())
    for notice in start_notices:
        log.warning("%s", notice)
        link.send_text(texts.fit(notice), WARNING, time.monotonic())
    log.info("perceiver: %s, %.0f ms a frame", ready.model, 1e3 * ready.step)
    log.info("ready: policy %s", daemon.calls.policy.name.lower())
    daemon.pointing.shown_for = beside.video.shown_for
    daemon.pack_incident, daemon.cancel_incident = beside.packer.ask, beside.packer.cancel
    closing.enter_context(daemon.recording.log_lines())
    report = CheckReport(config)
    served.show_checks(report.document)
    service.ready(time.monotonic())
    try:
        job = closing.enter_context(BackgroundJob())
        _run(daemon, link, stop, service, writer, report, job, beside)
    except Exception:
        log.critical("the supervisor's main loop failed: the companion stops")
        report_death(link, daemon.calls)
        raise
    service.stopping()
    daemon.leave()
    return 0


def _starting() -> dict[str, Any]:
    starting = {"state": "starting"}
    return {"told": "", "status": starting, "state": starting, "check": starting}


def _open_link(config: Config, served: ServedFiles, memory: Memory | None, saved: Mapping[str, Any]) -> Link:
    """Open the link with the parameters, words and policy that were in force before the restart.

    So the ground sees them from the first heartbeat on, while the perceiver still loads. The autopilot's
    script acts by that policy.
    """
    policy = restored_policy(config, saved.get("policy"), time.monotonic()).in_force
    link = Link(
        config.link.settings(),
        first_parameters(config, memory, policy, saved),
        time.monotonic(),
        tree=served.tree,
        signing=_signing(config),
        answer_store=AnswerStore(saved.get("replies")),
        camera=config.video.camera(config.camera.view),
    )
    link.text_parameters.set_words(first_words(config, memory))
    link.set_state(State.STARTING, open_id(saved), policy)
    return link


def _signing(config: Config) -> Signing | None:
    if config.link.signing_key is None:
        return None
    key, exempt = Path(config.link.signing_key), config.link.unsigned_autopilot
    return open_signing(key, config.journal.path, unsigned_autopilot=exempt)


def _run(
    daemon: Daemon,
    link: Link,
    stop: Callable[[], bool],
    service: ServiceManager,
    writer: Writer,
    report: CheckReport,
    background: BackgroundJob,
    beside: _Beside,
) -> None:
    page, video, recorder, live, packer = beside
    status_at = checked_at = float("-inf")
    figures: dict[str, Any] = {}

    def news() -> dict[str, Any]:
        document = report.document()
        ahead = daemon.ahead()
        return {
            "told": daemon.told(),
            "ahead": ahead,
            "status": figures,
            "state": daemon.state_file(),
            "check": document,
            "incidents": packer.document(),
        }

    def look_around() -> None:
        daemon.computer.measure()
        daemon.test_call.look()

    while not stop():
        daemon.turn()
        now = time.monotonic()
        if daemon.sees_or_reports_fault(now):
            service.alive(now)
        if now - status_at >= _STATUS_PERIOD:
            recording = {**recorder.figures(), "left_out": daemon.recording.left_out}
            figures = daemon.write_status(
                web=page.figures(), video=video.figures(), recording=recording, live=live.figures()
            )
            status_at = now
            service.status(f"{figures['state']}, policy {figures['policy']}")
            if status_at - checked_at < EVERY:
                background.run(look_around)
            elif background.run(partial(report.refresh, {**figures, "disk": writer.figures()})):
                checked_at = status_at
        told = daemon.recording.take()
        recorder.feed(now, told)
        live.feed(now, told)
        daemon.recording.listeners = recorder.listener, live.listener
        packer.poll(now)
        page.tell(now, news)
        if page.wanted():
            daemon.live_picture.want()
        if (picture := daemon.live_picture.take()) is not None:
            page.show(picture.frame, picture.captured_at, picture.jpeg)
        video.poll(now)
        link.camera.url, daemon.video_pictures.watched = video.url, video.watched
        if (picture := daemon.video_pictures.take(now)) is not None:
            video.show(picture.number, picture.jpeg)
