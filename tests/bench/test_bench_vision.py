"""What the death of the vision process costs: a few kills here, 200 by `make bench-vision`."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.vision.kills import kills

ROOT = Path(__file__).parents[2]


def test_no_acknowledged_answer_is_lost_or_applied_twice_when_vision_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    figures = kills(6, 1, tmp_path)
    assert figures["kills"] == 6
    assert (figures["lost"], figures["twice"]) == (0, 0)
    assert figures["returns"] >= 5
