"""A rover that has driven, made once."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("mcap")

from tests.companion.desk.evidence.driven import configured, drive
from tests.companion.desk.evidence.told import packed


@pytest.fixture(scope="session", autouse=True)
def _as_fast_as_others() -> Iterator[None]:
    """Keep the process of the tests from giving way, as the command does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "setpriority", lambda *_: None)
        yield


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
    packed(driven, path)
    return path
