"""Makes evidence, and reads what it tells as evidence.json has it."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from companion.cli import main
from companion.config import Config
from companion.config.schema import JournalSection
from companion.desk.evidence.package import DATA
from companion.desk.evidence.sources import Sources

NOON = 1_790_000_000.0


def sources(folder: Path, **more: Any) -> Sources:
    config = replace(Config(), journal=JournalSection(folder=str(folder)))
    return Sources(config, folder, NOON, **more)


def packed(config: Path, out: Path) -> dict[str, Any]:
    """The document of a file that the command writes, and finds good."""
    assert main(["evidence", "--no-check", str(config), "--out", str(out)]) == 0
    assert main(["evidence", "--verify", str(out)]) == 0
    return document(out)


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as found:
        return {name: found.read(name) for name in found.namelist()}


def document(path: Path) -> dict[str, Any]:
    told = json.loads(members(path)[DATA])
    assert isinstance(told, dict)
    return told


def figures(part: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a part's figures by their names."""
    return {one["name"]: one["value"] for one in part["figures"]}


def table(part: Mapping[str, Any], title: str) -> list[dict[str, Any]]:
    """The rows of a part's table."""
    (found,) = [one["rows"] for one in part["tables"] if one["title"] == title]
    return list(found)
