"""What must survive a restart, a full disk and a pulled plug: one SQLite file."""

from __future__ import annotations

from companion.journal.batch import Batch, Row
from companion.journal.errors import JournalError
from companion.journal.journal import Journal
from companion.journal.records import CallRecord

__all__ = ["Batch", "CallRecord", "Journal", "JournalError", "Row"]
