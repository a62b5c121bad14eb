from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.observers.page.page import missing
from tests.companion.observers.page.played import Stage


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """A page that is up, for tests that leave it as it is."""
    if missing():
        pytest.skip("the extra web is not installed")
    folder: Path = tmp_path_factory.mktemp("state")
    (folder / "calls").mkdir()
    (folder / "logs").mkdir()
    stage = Stage(folder)
    yield stage.ready()
    stage.close()
