"""The site of docs/: every page has its place in it, and no link is dead."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.slow


def built(root: Path, site: Path) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "-f",
        str(root / ".ci/docs/mkdocs.yml"),
        "-d",
        str(site),
    ]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)


def test_the_site_is_built_without_a_warning_and_its_search_knows_the_pages(tmp_path: Path) -> None:
    done = built(ROOT, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "stands against it" in (tmp_path / "search/search_index.json").read_text()
    readme = (tmp_path / "index.html").read_text()
    assert 'href="install.html"' in readme
    assert (tmp_path / "repository/config/ardupilot/anytraverse.lua").exists()


def test_dead_links_and_pages_without_a_place_fail(tmp_path: Path) -> None:
    for name in (".ci/docs", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name)
    (tmp_path / "README.md").write_text("[dead](docs/nowhere.md)")
    (tmp_path / "docs/new.md").write_text("[dead](guide.md#nowhere)")
    done = built(tmp_path, tmp_path / "site")
    assert done.returncode != 0
    for told in (
        "'nowhere.md', but the target is not found",
        "anchor '#nowhere'",
        'not included in the "nav"',
    ):
        assert told in done.stderr
