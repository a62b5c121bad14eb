"""`@PARAM/param.pck`: all parameters in a third of a list's bytes. MAVProxy asks for it before a list."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from companion.files.opened import Held, MissingError, Opened
from companion.wire.packed_parameters import Asked

FOLDER = "@PARAM"
NAME = "param.pck"


class ParameterFile:
    """A folder of the tree that holds this one file."""

    def __init__(self, pack: Callable[[Asked], bytes]) -> None:
        """pack: makes it; may raise ValueError."""
        self._pack = pack

    def sizes(self) -> Mapping[str, int]:
        return {NAME: len(self._pack(Asked()))}

    def open(self, name: str) -> Opened:
        """With what is asked behind a `?`. Raises FileError, ValueError."""
        file, _, query = name.partition("?")
        if file != NAME:
            raise MissingError(name)
        return Held(self._pack(Asked.read(query)))
