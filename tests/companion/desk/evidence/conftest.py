"""A rover that has driven, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mcap")

from companion.cli import main
from tests.companion.desk.evidence.driven import configured, drive


@pytest.fixture(scope="session")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The rover's configuration. What it has recorded lies in the folder `state` beside it."""
    folder = tmp_path_factory.mktemp("driven")
    drive(folder / "state")
    return configured(folder)


@pytest.fixture(scope="session")
def package(driven: Path) -> Path:
    """A file of evidence of that rover."""
    path = driven.parent / "evidence.zip"
    assert main(["evidence", "--no-check", "--config", str(driven), "--out", str(path)]) == 0
    return path
