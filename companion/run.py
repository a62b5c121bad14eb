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
from companion.config.stopping import longest_brake
from companion.daemon.call_alerts import CallAlerts
from companion.daemon.composition import Resources, compose, first_parameters, open_id, stored_u32
from companion.daemon.settings.file_change import FileChange
from companion.daemon.settings.from_page import SettingsFromPage
from companion.daemon.settings.runtime import first_words, restored_policy
from companion.daemon.startup import load, report_death
from companion.daemon.supervisor import Supervisor
from companion.daemon.turn import Observer, Turn
from companion.desk.check.table import EVERY, CheckReport
from companion.link.answer_store import AnswerStore
from companion.link.link import Link
from companion.link.signing import Signing, open_signing
from companion.observers.live.live import Live
from companion.observers.page.page import Page
from companion.observers.recording.deleting import RecordingDeleter
from companion.observers.recording.packer import IncidentPacker
from companion.observers.recording.recorder import Recorder
from companion.observers.video.video import Video
from companion.storage import Journal
from companion.storage.file_reader import FileReader
from companion.storage.log_file import log_to_file
from companion.storage.served_files import ServedFiles
from companion.storage.writer import Writer
from companion.system.alert import AlertSender
from companion.system.error_guard import BackgroundJob
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
    deleter: RecordingDeleter
    settings: SettingsFromPage

    @classmethod
    def of(cls, config: Config, file: Path | None) -> _Beside:
        page, settings = Page(config), SettingsFromPage(config, file, FileChange.of_service())
        page.offer_settings(settings.document(), settings.ask)
        settings.tell = page.tell_settings
        files = IncidentPacker(config), RecordingDeleter(config)
        return cls(page, Video(config), Recorder(config), Live(config), *files, settings)

    def poll(self, link: Link, now: float, news: Callable[[], Mapping[str, Any]]) -> None:
        """Keep them running, and hear them. news: what the page is told. link: tells where the video is."""
        self.page.tell(now, news)
        self.video.poll(now)
        link.camera.url = self.video.url
        self.recorder.poll(now)
        self.live.poll(now)
        self.packer.poll(now)
        self.deleter.poll()
        self.settings.poll(link.vehicle, now)

    def show(self, supervisor: Supervisor, now: float) -> None:
        """Give page and video the pictures that were drawn for them."""
        live, still = supervisor.live_picture, supervisor.video_pictures
        if self.page.wanted():
            live.want()
        if (picture := live.take()) is not None:
            from_above = supervisor.ground_view.png()
            self.page.show(picture.frame, picture.captured_at, picture.jpeg, from_above)
        still.watched = self.video.watched
        if (picture := still.take(now)) is not None:
            self.video.show(picture.number, picture.jpeg)


def main(
    config: Config,
    stop: Callable[[], bool] | None = None,
    vision: Sequence[str] | None = None,
    service: ServiceManager | None = None,
    file: Path | None = None,
) -> int:
    """Run the daemon until `stop()` is true (by default: on SIGTERM or SIGINT), and return the exit code.

    vision: the command line of the vision process, for one that has other perceivers. service: where systemd
    is told how it goes. file: where `config` stands, None: nowhere.
    Raises AnyTraverseError, LinkSettingError, ParameterError or JournalError for what a person must mend.
    """
    stop = stop or stop_on_signals()
    with ExitStack() as closing:
        service = service or ServiceManager()
        code = _main(config, stop, vision or COMMAND, service, closing, file)
        log.info("told to stop, and stopped")
        return code


def _main(
    config: Config,
    stop: Callable[[], bool],
    command: Sequence[str],
    service: ServiceManager,
    closing: ExitStack,
    file: Path | None,
) -> int:
    journal = Journal(config.journal.path)
    writer = closing.enter_context(Writer(journal))
    closing.enter_context(log_to_file(config.journal.path, writer))
    served = ServedFiles(config.journal.path, closing.enter_context(FileReader()))
    memory, saved = journal.load_memory(), journal.load_supervision() or {}
    # The memory lives as long as the daemon, and a full collection over all its scenes would stall the loop.
    gc.freeze()
    link = _open_link(config, served, memory, saved)
    closing.callback(link.close)
    first_frame = stored_u32(saved.get("frame_id")) + 1
    launch = partial(VisionChild, command, network=needs_of(config.camera.source).any)
    vision = VisionClient(launch, config, memory, VISION, first_frame=first_frame)
    closing.callback(vision.close)
    beside = _Beside.of(config, file)
    alerts = AlertSender(config.alert.url, config.alert.shown)
    closing.callback(alerts.close)
    for process in beside:
        closing.callback(process.close)
    served.show_incidents(beside.packer.document)
    link.answers.to_page = beside.page.acknowledge
    beside.page.answer = link.answers.receive_from_page

    ready = load(vision, link, stop, service, lambda now: beside.poll(link, now, _starting))
    if ready is None:
        service.stopping()
        return 0
    start_notices = list(ready.notices)
    supervisor = compose(
        config, Resources(link, vision, journal, writer, served, saved), ready, start_notices
    )
    if ready.model.int8_idle and config.perceiver.precision == "auto":
        start_notices.append(notices.int8_idle())
    for notice in start_notices:
        log.warning("%s", notice)
        link.texts.send(texts.fit(notice), WARNING, time.monotonic())
    log.info("perceiver: %s, %.0f ms a frame", ready.model, 1e3 * ready.step)
    log.info("ready: policy %s", supervisor.calls.policy.name.lower())
    supervisor.pointing.shown_for = beside.video.shown_for
    supervisor.files.packer, supervisor.files.deleter = beside.packer, beside.deleter
    supervisor.recording.feeds = beside.recorder, beside.live
    closing.enter_context(supervisor.recording.log_lines())
    checks = CheckReport(config)
    served.show_checks(checks.document)
    service.ready(time.monotonic())
    try:
        job = closing.enter_context(BackgroundJob())
        report = _StatusReporter(supervisor, beside, alerts, writer, checks, service, job)
        supervisor.observers.add(report)
        supervisor.observers.add(
            CallAlerts(supervisor.calls, supervisor.call_texts, alerts, config.alert.link)
        )
        _run(supervisor, link, stop, service, beside, report.news)
    except Exception:
        log.critical("the supervisor's main loop failed: the companion stops")
        report_death(link, supervisor.calls)
        raise
    service.stopping()
    supervisor.leave()
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
    link.modes.brake = longest_brake(config)
    link.text_parameters.set_words(first_words(config, memory))
    link.set_state(State.STARTING, open_id(saved), policy)
    return link


def _signing(config: Config) -> Signing | None:
    if config.link.signing_key is None:
        return None
    key, exempt = Path(config.link.signing_key), config.link.unsigned_autopilot
    return open_signing(key, config.journal.path, unsigned_autopilot=exempt)


class _StatusReporter(Observer):
    """Observes the turns: once a second it writes the status file, and tells systemd how it goes.

    It has the computer measured and the checks run, in the background, and makes what the page is told.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        beside: _Beside,
        alerts: AlertSender,
        writer: Writer,
        checks: CheckReport,
        service: ServiceManager,
        background: BackgroundJob,
    ) -> None:
        self._supervisor = supervisor
        self._beside = beside
        self._alerts = alerts
        self._writer = writer
        self._checks = checks
        self._service = service
        self._background = background
        self._told_at = self._checked_at = float("-inf")
        self._figures: dict[str, Any] = {}

    def see(self, turn: Turn) -> None:
        """Report, once a second."""
        if turn.now - self._told_at < _STATUS_PERIOD:
            return
        self._told_at = turn.now
        checks_due = turn.now - self._checked_at >= EVERY
        if not checks_due:  # first, since the rate of judging depends on it, whatever the report comes to
            self._background.run(self._look_around)
        left_out = self._supervisor.recording.left_out
        self._figures = figures = self._supervisor.write_status(
            web=self._beside.page.figures(),
            video=self._beside.video.figures(),
            recording={**self._beside.recorder.figures(), "left_out": left_out},
            live=self._beside.live.figures(),
            alert=self._alerts.figures(),
        )
        self._service.status(f"{figures['state']}, policy {figures['policy']}")
        if checks_due and self._background.run(
            partial(self._checks.refresh, {**figures, "disk": self._writer.figures()})
        ):
            self._checked_at = turn.now

    def news(self) -> dict[str, Any]:
        """Return what the page is told."""
        return {
            "told": self._supervisor.call_texts.told,
            "ahead": self._supervisor.status.ahead(),
            "status": self._figures,
            "state": self._supervisor.status.state_file(),
            "check": self._checks.document(),
            "incidents": self._beside.packer.document(),
        }

    def _look_around(self) -> None:
        self._supervisor.computer.measure()
        self._supervisor.test_call.look()


def _run(
    supervisor: Supervisor,
    link: Link,
    stop: Callable[[], bool],
    service: ServiceManager,
    beside: _Beside,
    news: Callable[[], Mapping[str, Any]],
) -> None:
    while not stop():
        supervisor.daemon.turn()
        now = time.monotonic()
        if supervisor.daemon.sees_or_reports_fault(now):
            service.alive(now)
        beside.poll(link, now, news)
        beside.show(supervisor, now)
