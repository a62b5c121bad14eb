"""All that the ground may read of a companion, from its first second on."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from anytraverse.assessment import Assessment
from companion.files.calls import PATTERN
from companion.files.folder import Folder
from companion.files.maps import NewestMaps
from companion.files.reader import Reader
from companion.files.tree import Document, Tree
from companion.logbook import FOLDER, NAME


class Offer:
    """/state.json, /calls, /maps and /logs."""

    def __init__(self, folder: Path, reader: Reader | None = None) -> None:
        """folder: where the companion keeps what must survive. reader: of what lies on the disk."""
        self.calls = folder / "calls"
        with suppress(OSError):  # whoever writes there says what is wrong
            self.calls.mkdir(parents=True, exist_ok=True)
        self._figures: Callable[[], Mapping[str, Any]] = lambda: {"state": "starting"}
        self._newest: Callable[[], Assessment | None] = lambda: None
        self.tree = Tree(
            {
                "state.json": Document(self._state),
                "calls": Folder(self.calls, PATTERN, reader),
                "maps": NewestMaps(self._newest_frame).documents(),
                "logs": Folder(folder / FOLDER, f"{NAME}*", reader),
            }
        )

    def show(self, figures: Callable[[], Mapping[str, Any]], newest: Callable[[], Assessment | None]) -> None:
        """It looks now. figures: asked for what /state.json tells. newest: for the newest frame."""
        self._figures, self._newest = figures, newest

    def _newest_frame(self) -> Assessment | None:
        return self._newest()

    def _state(self) -> bytes:
        return json.dumps(self._figures(), separators=(",", ":")).encode()
