"""What evidence tells of now: the program, the model, and what `companion check` says."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import pytest

from companion.config import load_config
from companion.desk.evidence import versions
from companion.desk.evidence.checked import check_part, run_check
from companion.desk.evidence.collect import read_sources
from companion.desk.evidence.versions import versions_part
from tests.companion.desk.evidence.told import figures, sources, table


@pytest.mark.skipif(os.geteuid() != 0, reason="only root reads a checkout of somebody else")
def test_the_commit_of_another_users_checkout_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for path in (tmp_path, *tmp_path.parents[:2]):
        path.chmod(0o755)
    made = ("-c", "user.name=x", "-c", "user.email=x", "commit", "-q", "--allow-empty", "-m", "x")
    for words in (("init", "-q"), made):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    for path in (tmp_path, *tmp_path.rglob("*")):
        os.chown(path, 65534, 65534)
    monkeypatch.setattr(versions, "_ROOT", tmp_path)
    assert figures(versions_part(sources(tmp_path)).document())["commit"]


@pytest.mark.parametrize("perceiver", [None, [], {"model": 7}, {"model": ""}])
def test_a_status_that_names_no_model_tells_none(tmp_path: Path, perceiver: object) -> None:
    part = versions_part(sources(tmp_path, status={"perceiver": perceiver}))
    assert "the model that judged" in [one.what for one in part.unknown]


def test_root_in_anybodys_folder_runs_nothing_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "companion").mkdir()
    (tmp_path / "companion" / "__init__.py").write_text("")
    (tmp_path / "companion" / "__main__.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    rows, _ = run_check("nothere.toml", 60.0)
    assert not (tmp_path / "ran").exists(), rows


def test_a_check_that_does_not_end_is_ended(tmp_path: Path) -> None:
    began = time.monotonic()
    assert run_check(str(tmp_path / "companion.toml"), 0.01) == (
        [],
        "companion check did not end within 0.01 s",
    )
    assert time.monotonic() - began < 5.0


@pytest.mark.slow
def test_what_companion_check_says_now_is_in_it(driven: Path) -> None:
    found = read_sources(load_config(str(driven)), str(driven))
    rows = {one["check"]: one["verdict"] for one in found.checked}
    assert rows["config"] == "pass", found.no_check
    assert rows["camera"] == "fail"
    assert table(check_part(found).document(), "What companion check says now")
