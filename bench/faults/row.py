"""One row of the fault table: a fault, how it is produced, and the state that must follow."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

HOLD_WITHIN = 2.0
"""s from the last verified OK to the companion's order: T, 1 s in the rovers' configuration, and 1 s."""
CAMERA_BACK_WITHIN, BACK_WITHIN = 10.0, 12.0
"""s from the end of a camera's fault, and of any other, until the companion is well again."""


class Work(NamedTuple):
    """What a row gets to work with.

    folder: an empty folder of its own. seed: of everything that is random. short: produce the fault once or
    a few times only, as in the tests; else as often as the row says, or `runs` times where it is repeated on
    stages. None: as the row says.
    """

    folder: Path
    seed: int
    short: bool
    runs: int | None = None

    def seeds(self, times: int) -> range:
        """Returns a seed for each run of a row that says `times`."""
        return range(self.seed, self.seed + (1 if self.short else self.runs or times))


class RowOutcome(NamedTuple):
    """What was seen.

    runs: how often the fault was produced. wrong: a line for each run that did not end in the safe state.
    hold_s: longest s from the last verified OK to the order to hold; None where nobody has to hold.
    return_s: longest s from the end of the fault until the companion was well; None where it does not end.
    saw: what the operator, the status or the log said, in a few words.
    """

    runs: int
    wrong: tuple[str, ...] = ()
    hold_s: float | None = None
    return_s: float | None = None
    saw: str = ""


class Row(NamedTuple):
    """A row. fault, produced, safe_state: for a reader, in a few words.

    hold_within, return_within: limits in s of `RowOutcome.hold_s` and `RowOutcome.return_s`.
    exception: why no safe state follows as shipped, and what can change that. Such a row counts as not
    safe, and is wrong only where something else follows than `safe_state` says. "": it must be safe.
    """

    fault: str
    produced: str
    safe_state: str
    produce: Callable[[Work], RowOutcome]
    hold_within: float | None = None
    return_within: float | None = None
    exception: str = ""
