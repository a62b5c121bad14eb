"""Creates the daemon's parts and restores what the journal stored, for `companion run`, tests and benches."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

from anytraverse.judging import Settings
from anytraverse.memory import Memory
from companion.calls.machine import OperatorCalls
from companion.calls.snapshot import restore
from companion.config import Config, format_config
from companion.config.stopping import Stopping, describe_tile
from companion.daemon.answers.handler import AnswerHandler
from companion.daemon.call_frames import CallFrames
from companion.daemon.call_texts import CallTexts
from companion.daemon.daemon import Daemon, Deciders
from companion.daemon.executor import DecisionExecutor
from companion.daemon.ground_view import GroundView
from companion.daemon.guiding import GuideService
from companion.daemon.health import HealthMonitor
from companion.daemon.live_picture import LivePicture, VideoPictures
from companion.daemon.persistence import Persistence
from companion.daemon.pointing import Pointing
from companion.daemon.policy.hold_gate import HoldConditions, HoldGate
from companion.daemon.policy.service import PolicyService
from companion.daemon.policy.shadow_statistics import ShadowReporter, ShadowStatistics
from companion.daemon.recording import Recording
from companion.daemon.records import Records
from companion.daemon.reports import VehicleReports, VisionResults
from companion.daemon.requests import FilesRequests, Requests
from companion.daemon.settings.echo import ParameterEcho
from companion.daemon.settings.runtime import (
    RuntimeSettings,
    call_numbers,
    first_values,
    first_words,
    restored_policy,
    storable_defaults,
)
from companion.daemon.settings.service import SettingsService
from companion.daemon.settings.words import WordSettings
from companion.daemon.status import Status, StatusFile
from companion.daemon.supervisor import Supervisor
from companion.daemon.telemetry import Telemetry
from companion.daemon.trial_call import TrialCall
from companion.daemon.turn import Event, Observers
from companion.link.link import Link
from companion.storage import Journal
from companion.storage.call_files import CallFiles, PictureArchive
from companion.storage.served_files import ServedFiles
from companion.storage.writer import SLOW, Writer
from companion.system.computer import Computer
from companion.system.error_guard import ErrorGuard
from companion.tasks import Liveness, tasks
from companion.vehicle.course import CourseJudge
from companion.vehicle.state import VehiclePosition
from companion.vision.client import VisionClient
from companion.vision.messages import Ready
from companion.wire import notices
from companion.wire.ids import ERROR, Policy
from companion.wire.parameters import POLICY, Parameter, build

log = logging.getLogger(__name__)

_U32 = 0xFFFFFFFF


class Resources(NamedTuple):
    """Holds the opened resources of a daemon. Their opener closes them. saved: state from the journal."""

    link: Link
    vision: VisionClient
    journal: Journal
    writer: Writer
    served: ServedFiles
    saved: Mapping[str, Any]


def compose(
    config: Config,
    opened: Resources,
    ready: Ready,
    startup_notices: list[str],
    *,
    state_machine: type[OperatorCalls] = OperatorCalls,
) -> Supervisor:
    """Create the daemon and its parts, once vision is ready.

    Adds notices for the operator to `startup_notices`.
    """
    link, vision, journal, writer, served, saved = opened
    # An answer may wait for its outcome, and then for the disk.
    link.answer_store.set_undecided_for(vision.answers_within + SLOW)
    model, now, folder = ready.model, time.monotonic(), config.journal.path
    if journal.recovered_from is not None:
        startup_notices.insert(0, f"journal was damaged: {journal.recovered}")
    overrides, judging = restore_settings(config, ready, saved.get("settings"), startup_notices)
    text, in_time = describe_tile(config, judging)
    log.log(logging.INFO if in_time else logging.WARNING, "%s", text)
    policy_state = restored_policy(config, saved.get("policy"), now)
    last_id = stored_u32(saved.get("last_id")) & 0xFFFF
    calls = state_machine(call_numbers(config, judging), policy_state, now, last_id)
    if saved:
        restore_calls(calls, saved, now, startup_notices)
    statistics = restore_statistics(model.id, calls, saved.get("shadow"), now, startup_notices)
    position = VehiclePosition(lambda: link.vehicle)
    frame_id, stamp = stored_u32(saved.get("frame_id")), position.clock.stamp
    persistence = Persistence(writer, calls, link.answer_store, frame_id, stamp)
    answer_handler = AnswerHandler(calls, vision, link.answer_store, link.share)
    link.dead_man.enabled = config.call.px4_deadman == "manual_control"
    parameters = build(config.vocabulary, config.words, first_values(config), aliases=config.aliases)
    echo = ParameterEcho(parameters, link, persistence.after_write)
    guide = GuideService(config, link, calls)
    policy = PolicyService(link, vision, calls, policy_state, HoldGate(config), echo, guide.lacks)
    if policy_state.requested.holds:
        _tell_of_stopping(config, judging, ready.step, startup_notices)
    settings = SettingsService(
        link,
        policy,
        overrides,
        WordSettings(parameters, link, vision, answer_handler, echo),
        statistics,
        echo,
    )
    vision.tune(judging)  # vision judges no frame before this
    settings.start(now)
    events = list[Event]()
    guard = ErrorGuard(lambda now: link.texts.send(notices.unexpected_error(), ERROR, now))
    frames = CallFrames(vision, calls, persistence, position, events)
    liveness, computer = Liveness(tasks(calls.numbers), now), Computer(folder)
    health = HealthMonitor(liveness, link, vision, calls, persistence)
    executor = DecisionExecutor(
        link.modes, frames, persistence, statistics, calls, health.fault_name, guard, events
    )
    test_call, files = TrialCall(folder, calls, link, vision, position), FilesRequests(link, vision)
    requests = Requests(link, executor, persistence, settings, answer_handler, (files, test_call))
    deciders = Deciders(
        requests,
        VehicleReports(link, calls, position, CourseJudge(config.mount.heading, config.camera.view)),
        guide,
        VisionResults(calls, persistence, frames, executor, requests, answer_handler),
        policy,
        test_call,
        health,
        computer,
    )
    records = Records(
        vision,
        calls,
        writer,
        PictureArchive(folder / "pictures", config.pictures.keep),
        CallFiles(served.calls),
    )
    frames.restore(journal)
    records.restore(journal)
    view, status_file = round(config.camera.view), StatusFile(writer, folder / "status.json")
    status = Status(link, vision, calls, settings, records, computer, guide, view=view)
    call_texts, pointing = CallTexts(link.texts, link.alerts, calls, records), Pointing(calls, link)
    shadow, live_picture = ShadowReporter(statistics, link.texts), LivePicture(vision)
    ground_view = GroundView(policy)
    video_pictures = VideoPictures(vision, pointing, call_texts, config.video.rate)
    recording = Recording(
        vision, calls, settings, position.clock, rate=config.recording.rate, config=format_config(config)
    )
    # The figures of a frame do not wait for its files and pictures, nor texts for pictures that are shown.
    observers = Observers(
        (
            Telemetry(link, view),
            status,
            status_file,
            records,
            call_texts,
            shadow,
            pointing,
            video_pictures,
            live_picture,
            ground_view,
            recording,
        ),
        guard,
    )
    served.started(status.state_file, lambda: calls.reason_filter.newest, ground_view.png)
    return Supervisor(
        daemon=Daemon(link, vision, calls, executor, deciders, observers),
        calls=calls,
        persistence=persistence,
        frames=frames,
        settings=settings,
        answer_handler=answer_handler,
        position=position,
        computer=computer,
        files=files,
        test_call=test_call,
        observers=observers,
        status=status,
        status_file=status_file,
        records=records,
        call_texts=call_texts,
        shadow=shadow,
        pointing=pointing,
        live_picture=live_picture,
        ground_view=ground_view,
        video_pictures=video_pictures,
        recording=recording,
    )


def restore_settings(
    config: Config, ready: Ready, saved: Any, startup_notices: list[str]
) -> tuple[RuntimeSettings, Settings]:
    """Restore the settings that the ground had changed, as far as they still fit the configuration.

    Returns them and the settings for judging frames. Adds to `startup_notices` which were left out.
    """
    overrides = RuntimeSettings(storable_defaults(config, ready.settings), ready.model.id)
    left_out = overrides.restore(saved)
    judging, misfits = overrides.tuned(ready.settings)
    startup_notices += [*left_out, *misfits]
    if judging.misfit:
        log.error("%s: set AT_ROI_L and AT_ROI_R, or correct [roi] or [corridor] in the file", judging.misfit)
        startup_notices.append(notices.fault_region(judging.misfit))
    if overrides.values:
        log.warning("set by the ground, not as in the file: %s", overrides.figures())
    return overrides, judging


def _tell_of_stopping(config: Config, judging: Settings, step: float, startup_notices: list[str]) -> None:
    """Log whether the vehicle stops in time, which the owner wants it to be held by."""
    guides = config.call.policy == "guide"
    stopping = HoldGate(config).stopping(HoldConditions(judging, step, guides=guides))
    if isinstance(stopping, Stopping):
        log.info("stopping: %s", stopping.describe())
    elif config.stopping.unchecked:
        log.warning("stopping distance was not checked: %s", stopping)
        startup_notices.append(notices.stopping_unchecked())


def first_parameters(
    config: Config, memory: Memory | None, policy: Policy, saved: Mapping[str, Any]
) -> tuple[Parameter, ...]:
    """Make the parameters with their values before the restart, until the perceiver is loaded."""
    words = first_words(config, memory)
    offered = {word: words[word] for word in config.vocabulary if word in words}
    values = {**first_values(config, saved.get("settings")), POLICY: float(policy)}
    return build(config.vocabulary, offered, values, aliases=config.aliases)


def open_id(saved: Mapping[str, Any]) -> int:
    """Return the id of the call or hold that was open at the restart, 0 without one.

    The first heartbeats carry it, so that a ground station does not take the call for closed.
    """
    open_one = saved.get("call") or saved.get("hold")
    return stored_u32(open_one.get("id")) if isinstance(open_one, dict) else 0


def stored_u32(value: Any) -> int:
    """Return a stored unsigned number of 32 bits, 0 for any other value."""
    return value if isinstance(value, int) and 0 <= value <= _U32 else 0


def restore_calls(
    calls: OperatorCalls, saved: Mapping[str, Any], now: float, startup_notices: list[str]
) -> None:
    """Restore call and hold. Adds to `startup_notices` what could not be read."""
    try:
        restore(calls, saved, now)
    except (KeyError, TypeError, ValueError) as error:
        startup_notices.append(f"open call not restored: {error!r}")
    if calls.current_id:
        log.warning("restarted with %s %d open", calls.kind.name.lower(), calls.current_id)


def restore_statistics(
    model: str, calls: OperatorCalls, saved: Any, now: float, startup_notices: list[str]
) -> ShadowStatistics:
    """Restore the statistics of policy shadow. Ends would-be holds if another policy is in force now."""
    statistics, notice = ShadowStatistics.restored(saved, calls.shadow, model, now, time.time())
    if notice:
        log.warning("%s", notice)
        startup_notices.append(notice)
    if calls.policy is not Policy.SHADOW:
        for over in calls.shadow.stop(now):
            statistics.ended(over)
    return statistics
