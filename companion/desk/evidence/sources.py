"""Holds all that evidence is made from: what is stored, and what was read now. Each part takes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from companion.config import Config
from companion.desk.evidence.drives import DrivenFacts
from companion.desk.evidence.log import LogFacts
from companion.wire.call_report import CallReport


@dataclass(frozen=True)
class Sources:
    """What evidence is made from.

    folder: the companion's state. now: seconds since 1970.
    written, status: when status.json was written, seconds since 1970, None without one, and its content.
    running: whether a companion runs with this folder now.
    driven: what the recordings tell. logged: what the log tells. journal: closed calls with their answers,
    None where the journal could not be read: `no_journal` says why. checked: rows of `companion check`;
    `no_check` says why there are none.
    """

    config: Config
    folder: Path
    now: float
    written: float | None = None
    status: Mapping[str, Any] = field(default_factory=dict)
    running: bool = False
    journal: Sequence[CallReport] | None = None
    no_journal: str = ""
    driven: DrivenFacts = field(default_factory=DrivenFacts)
    logged: LogFacts = field(default_factory=LogFacts)
    checked: Sequence[Mapping[str, str]] = ()
    no_check: str = ""
