"""Messages to record, and a supervisor that records them."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from anytraverse.frame import Frame
from companion.config import Config
from companion.config.schema import JournalSection, RecordingSection
from companion.observers.recording.contents import as_json, image
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.recorder import Recorder
from companion.observers.recording.ring import FOLDER
from companion.observers.recording.topics import Topic
from companion.system.watchdog import Restarts
from companion.vision.worker import Worker
from tests.companion.daemon.rig import picture
from tests.companion.observers.supervisor import Supervisor
from tests.companion.vision.played import engine

NS = 1_000_000_000
BEGAN = 1_790_000_000 * NS
LIMITS = Restarts(silent_for=2.5, loading=20.0, first=0.1, longest=0.2)
SEEN = Worker(engine(None), 1).judge(Frame(5, time.monotonic(), picture("drum"))).assessment


def status(number: int, seconds: float = 0.0) -> RecordedMessage:
    """A small message."""
    return RecordedMessage(
        Topic.STATUS, BEGAN + round(seconds * NS), as_json({"state": "ok", "number": number})
    )


def frame(number: int, seconds: float = 0.0, size: int = 20_000) -> RecordedMessage:
    """A message that cannot be compressed."""
    import random

    at = BEGAN + round(seconds * NS)
    return RecordedMessage(Topic.CAMERA, at, image(random.Random(number).randbytes(size), "jpeg", at), number)


def opened(call: int, seconds: float = 0.0) -> RecordedMessage:
    """A call opens."""
    content = as_json({"decision": "call opened", "id": call, "reasons": ["unknown_object"]})
    return RecordedMessage(Topic.DECISIONS, BEGAN + round(seconds * NS), content, event=True)


def words(weight: float, seconds: float = 0.0) -> RecordedMessage:
    """Words come into force."""
    content = as_json({"words": {"grass": weight}, "taps": {}})
    return RecordedMessage(Topic.WORDS, BEGAN + round(seconds * NS), content)


class Stage(Supervisor):
    """Runs a `Recorder` and its process."""

    def __init__(self, folder: Path, size: int = 20, **more: Any) -> None:
        self.folder = folder / FOLDER
        config = replace(
            Config(), journal=JournalSection(folder=str(folder)), recording=RecordingSection(size)
        )
        self.service = self.recorder = Recorder(config, **{"restarts": LIMITS, **more})

    @property
    def files(self) -> list[Path]:
        return sorted(self.folder.glob("*.mcap"))
