"""What can be wrong with a journal.

JournalError     it cannot be opened or written; what was kept before is still there
└── Damaged      the file is torn: it must be set aside
"""

from __future__ import annotations


class JournalError(Exception):
    """The journal cannot be opened or written; what was kept before stays. The text tells what to do."""


class Damaged(JournalError):  # noqa: N818
    """The file is no journal any more."""
