"""Makes sources of evidence, and reads what a part tells as evidence.json has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from companion.config import Config
from companion.config.schema import JournalSection
from companion.desk.evidence.sources import Sources

NOON = 1_790_000_000.0


def sources(folder: Path, **more: Any) -> Sources:
    config = replace(Config(), journal=JournalSection(folder=str(folder)))
    return Sources(config, folder, NOON, **more)


def figures(part: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a part's figures by their names."""
    return {one["name"]: one["value"] for one in part["figures"]}


def table(part: Mapping[str, Any], title: str) -> list[dict[str, Any]]:
    """The rows of a part's table."""
    (found,) = [one["rows"] for one in part["tables"] if one["title"] == title]
    return list(found)
