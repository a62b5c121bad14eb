"""Evidence of a companion that runs in processes of its own, while it runs and after it was killed."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest

pytest.importorskip("mcap")

from anytraverse.perception import KINDS
from tests.companion.desk.evidence.told import figures, packed
from tests.companion.observers.recording.test_beside_a_daemon import PAINTED
from tests.companion.processes import Companion

pytestmark = pytest.mark.slow


def test_it_reads_what_runs_and_disturbs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KINDS, "painted", PAINTED)
    (tmp_path / "rover").mkdir()
    with closing(Companion(tmp_path / "rover", recorded="20")) as companion:
        companion.until(lambda: companion.told().get("current_id"))
        companion.until(lambda: companion.told().get("recording", {}).get("written", 0) > 100)
        frames = companion.told()["frames"]
        told = packed(companion.config, tmp_path / "running.zip")
        assert figures(told["parts"]["versions"])["model"] == "painted-1"
        assert figures(told["parts"]["calls"])["time recorded"] > 0.0
        companion.until(lambda: companion.told()["frames"] > frames + 5)
        assert companion.told()["vision"]["restarts"] == 0
        companion.process.kill()
        companion.process.wait()
        told = packed(companion.config, tmp_path / "killed.zip")
        faults = figures(told["parts"]["faults"])
        assert faults["ends without being told to stop: killed, crashed, or without power"] == 1
        assert faults["starts of the companion"] == 1
