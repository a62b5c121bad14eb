"""The benchmark of growth, with a few points of each part."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.growth import daemon, history, hours, sizes, words
from bench.growth.hours import drive
from bench.series import Series, slope


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.series._ENOUGH", 0.0)


def test_a_rise_is_found_with_its_interval_and_its_beginning_does_not_count() -> None:
    noise = [0.02, -0.01, 0.0, 0.01, -0.02, 0.03, -0.03]
    rising = [[1000 * n, 50 + n * 0.01 + noise[n % 7], 0, 0] for n in range(1, 51)]
    found = slope(rising, 1e5)
    assert found.low < 1.0 < found.high
    assert found.high - found.low < 0.2
    filling = [[1000 * n, min(n, 8) + noise[n % 7], 0, 0] for n in range(1, 51)]
    found = slope(filling, 1e5)
    assert found.low < 0 < found.high


def test_what_remembered_scenes_cost_is_measured_at_every_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "COUNTS", (3, 70))
    frame, start, disk = history.measure(quick=True, bundle=None)
    _has(frame, [3, 70], 6)
    _has(start, [3, 70], 4)
    _has(disk, [3, 70], 3)
    bytes_ = {name: points[1][1] - points[0][1] for name, points in disk.lines.items()}
    assert all(0.1 < grown < 1.0 for grown in bytes_.values()), "67 scenes of 512 numbers each"


def test_a_frame_is_measured_by_words_and_what_it_keeps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(words, "COUNTS", (1, 2))
    times, kept = words.measure(quick=True, bundle=None)
    _has(times, [1, 2], 3)
    assert kept.lines["builtin"][0][1] > 640 * 480 * 3 / 1e6


def test_a_frame_and_its_pictures_are_measured_by_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sizes, "SIZES", ((320, 240),))
    times, bytes_ = sizes.measure(quick=True, bundle=None)
    _has(times, [0.077], 7)
    _has(bytes_, [0.077], 5)


def test_a_drive_is_measured_over_its_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hours, "_SAMPLES", 10)
    memory, disk, times, against = drive(30, tmp_path)
    _has(memory, list(range(3, 31, 3)), 1)
    _has(disk, list(range(3, 31, 3)), 1)
    _has(times, list(range(3, 31, 3)), 5)
    _has(against, list(range(3, 31, 3)), 2)
    found = slope(memory.lines["own memory"], 1e5)
    assert found.low <= found.value


def test_the_main_process_of_a_whole_daemon_is_measured_while_it_is_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(daemon, "_SAMPLES", 10)
    memory, held = daemon.drive(6.0, tmp_path)
    assert "1 calls, 1 answered" in capsys.readouterr().out
    for name in ("main process, own memory", "main process, PSS"):
        assert all(10 < low <= value <= high < 200 for _, value, low, high in memory.lines[name])
    assert all(value >= 2 for line in held.lines.values() for _, value, _, _ in line)


def _has(series: Series, places: list[float], lines: int) -> None:
    assert len(series.lines) == lines
    for points in series.lines.values():
        assert [point[0] for point in points] == places
        assert all(0 < low <= value <= high for _, value, low, high in points)
