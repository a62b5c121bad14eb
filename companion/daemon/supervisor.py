"""Has the parts of a composed daemon, for whoever runs it and shows it to people."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from companion.calls.machine import OperatorCalls
from companion.daemon.answers.handler import AnswerHandler
from companion.daemon.call_frames import CallFrames
from companion.daemon.call_texts import CallTexts
from companion.daemon.daemon import Daemon
from companion.daemon.ground_view import GroundView
from companion.daemon.live_picture import LivePicture, VideoPictures
from companion.daemon.persistence import Persistence
from companion.daemon.pointing import Pointing
from companion.daemon.policy.shadow_statistics import ShadowReporter
from companion.daemon.recording import Recording
from companion.daemon.records import Records
from companion.daemon.requests import FilesRequests
from companion.daemon.settings.service import SettingsService
from companion.daemon.status import Status, StatusFile
from companion.daemon.trial_call import TrialCall
from companion.daemon.turn import Observers
from companion.system.computer import Computer
from companion.vehicle.state import VehiclePosition


@dataclass(frozen=True)
class Supervisor:
    """The parts. Call `daemon.turn` until the end, then `leave`."""

    daemon: Daemon
    calls: OperatorCalls
    persistence: Persistence
    frames: CallFrames
    settings: SettingsService
    answer_handler: AnswerHandler
    position: VehiclePosition
    computer: Computer
    files: FilesRequests
    test_call: TrialCall
    observers: Observers
    status: Status
    status_file: StatusFile
    records: Records
    call_texts: CallTexts
    shadow: ShadowReporter
    pointing: Pointing
    live_picture: LivePicture
    ground_view: GroundView
    video_pictures: VideoPictures
    recording: Recording

    def leave(self) -> None:
        """End in good order: hand over a hold that needs us, then write everything that waits."""
        self.shadow.log_totals()
        self.daemon.release()
        self.persistence.leave()
        self.status_file.leave(self.status.figures())

    def write_status(self, **more: Any) -> dict[str, Any]:
        """Queue the status file, and return its content. more: figures of parts that are not the daemon's."""
        figures = self.status_file.write({**self.status.figures(), **more})
        self.recording.status(figures, time.monotonic())
        return figures
