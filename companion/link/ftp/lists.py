"""Lists of folders, page by page."""

from __future__ import annotations

from collections import OrderedDict

from companion.files.tree import Entry, Tree
from companion.link.heard import Sender
from companion.wire.ftp import FtpPayload

MAX_LISTS = 8


class Lists:
    """Remembers the last list of eight senders, so that it does not change from one page to the next."""

    def __init__(self, tree: Tree) -> None:
        self._tree = tree
        self._kept: OrderedDict[Sender, tuple[str, tuple[Entry, ...]]] = OrderedDict()

    def page(self, sender: Sender, request: FtpPayload, room: int) -> bytes:
        """Whole entries of the folder asked for, from number `request.offset`: one and what fits `room`.

        Empty after the last. Raises FileError, PayloadError.
        """
        data = b""
        for entry in self._entries(sender, request)[request.offset :]:
            line = _line(entry)
            if data and len(data) + len(line) > room:
                break
            data += line
        return data

    def _entries(self, sender: Sender, request: FtpPayload) -> tuple[Entry, ...]:
        path = request.path()
        kept, entries = self._kept.get(sender, ("", ()))
        if request.offset == 0 or kept != path:
            entries = self._tree.entries(path)
            self._kept[sender] = path, entries
            self._kept.move_to_end(sender)
            if len(self._kept) > MAX_LISTS:
                self._kept.popitem(last=False)
        return entries


def _line(entry: Entry) -> bytes:
    """Type, name, size and a NUL: one client overwrites the last byte of what it gets."""
    text = f"D{entry.name}" if entry.size is None else f"F{entry.name}\t{entry.size}"
    return text.encode() + b"\0"
