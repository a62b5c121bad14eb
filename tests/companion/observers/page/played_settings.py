"""A page with settings of a file, what the supervisor does for it, and root's helper, in this process."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from companion.config import load_config
from companion.config.request import REQUEST
from companion.config.root_helper import answered, leave
from companion.daemon.settings.file_change import FileChange
from companion.daemon.settings.from_page import SettingsFromPage
from companion.observers.recording.messages import RecordedMessage
from companion.vehicle.state import Vehicle
from tests.companion.observers.page.played import TOKEN, Stage

FILE = f"""[vehicle]
file = ""
[camera]
source = "rtsp://me:s3cr3tword@10.0.0.9/1"
[web]
token = "{TOKEN}"
# How often.
[call]
votes = 2
"""


class SettingsStage(Stage):
    """A `Stage` whose page has settings. helper: there is one. text: of the file.

    armed: of the vehicle, None: unheard.
    """

    def __init__(self, folder: Path, *, helper: bool = True, text: str = FILE, **options: Any) -> None:
        super().__init__(folder, **options)
        self.file, self.run, self.answers = folder / "companion.toml", folder / "run", folder / "answers"
        self.run.mkdir()
        self.answers.mkdir()
        self.file.write_text(text)
        self.file.chmod(0o600)
        self.armed: bool | None = False
        self.start(FileChange(self.run, self.answers) if helper else None)

    def start(self, change: FileChange | None) -> None:
        """Do what the supervisor does when it starts, with what is in its file."""
        self.settings = SettingsFromPage(load_config(self.file), self.file, change)
        self.page.offer_settings(self.settings.document(), self.settings.ask)
        self.settings.tell = self.page.tell_settings

    def start_again(self) -> None:
        self.settings.close()
        self.start(FileChange(self.run, self.answers))

    def work(self, now: float, messages: Sequence[RecordedMessage]) -> None:
        super().work(now, messages)
        vehicle = None if self.armed is None else Vehicle(1, 3, 0, armed=self.armed, heard_at=now)
        self.settings.poll(vehicle, now)
        if (self.run / REQUEST).exists():
            leave(answered(self.file, self.run, os.getuid()), self.answers)

    def close(self) -> None:
        self.settings.close()
        super().close()
