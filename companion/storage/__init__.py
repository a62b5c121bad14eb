"""Stores what must survive a restart, a full disk and a loss of power, in one SQLite file."""

from __future__ import annotations

from companion.storage.batch import Batch, TableRow
from companion.storage.database import JournalError
from companion.storage.journal import Journal

__all__ = ["Batch", "Journal", "JournalError", "TableRow"]
