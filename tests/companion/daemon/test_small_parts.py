"""The picture archive, the odometer, liveness and the error guard, each alone."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from companion.calls.numbers import Numbers
from companion.daemon.status import FrameRate
from companion.storage.call_files import PictureArchive
from companion.system.error_guard import ErrorGuard
from companion.tasks import Liveness, tasks
from companion.vehicle.state import Odometer

JPEG = b"a picture"


def names(folder: Path) -> list[str]:
    """The pictures in it."""
    return sorted(path.name for path in folder.iterdir())


def test_a_picture_archive_keeps_the_newest_pictures_over_restarts(tmp_path: Path) -> None:
    for number in range(3):
        PictureArchive(tmp_path, 2).add(JPEG, f"C{number} Unknown thing!")
    assert names(tmp_path) == ["00002-c1-unknown-thing.jpg", "00003-c2-unknown-thing.jpg"]


def test_a_picture_archive_of_many_years_stays_bounded(tmp_path: Path) -> None:
    (tmp_path / "99999-old.jpg").touch()
    for _ in range(2):
        pictures = PictureArchive(tmp_path, 2)
        pictures.add(JPEG, "new")
        pictures.add(JPEG, "new")
    assert names(tmp_path) == ["100002-new.jpg", "100003-new.jpg"]


def test_a_picture_archive_leaves_other_files_alone_and_clears_torn_ones(tmp_path: Path) -> None:
    (tmp_path / "notes-of-mine.jpg").touch()
    (tmp_path / ".00007-torn.jpg.part").touch()
    PictureArchive(tmp_path, 1).add(JPEG, "new")
    assert names(tmp_path) == ["00001-new.jpg", "notes-of-mine.jpg"]


def test_a_picture_archive_of_none_is_not_wanted(tmp_path: Path) -> None:
    assert not PictureArchive(tmp_path / "none", 0).wanted
    assert not (tmp_path / "none").exists()


def test_an_odometer_adds_up_slow_driving_but_not_noise_or_jumps() -> None:
    odometer = Odometer()
    assert odometer.travelled(None) is None
    degree = 111_320.0
    for step in range(101):
        travelled = odometer.travelled((50.0 + step * 0.1 / degree, 7.0, None))
    assert travelled == pytest.approx(10.0, abs=0.4)
    for noise in (0.05, -0.05, 0.05):
        assert odometer.travelled((50.0 + (10.0 + noise) / degree, 7.0, None)) == travelled
    assert odometer.travelled((51.0, 7.0, None)) == travelled, "a new fix is no way"
    assert odometer.travelled(None) == travelled


def test_an_odometer_counts_east_by_the_latitude() -> None:
    odometer = Odometer()
    odometer.travelled((60.0, 7.0, 0.0))
    assert odometer.travelled((60.0, 7.0 + 10.0 / 111_320.0, 0.0)) == pytest.approx(5.0, rel=0.01)


def test_the_most_basic_silent_task_is_named_first() -> None:
    liveness = Liveness(tasks(Numbers()), 0.0)
    assert liveness.silent(1.0) == []
    assert liveness.silent(1.1) == ["camera", "vision"]
    liveness.beat("camera", 5.0)
    liveness.beat("camera", 4.0)
    assert liveness.silent(5.9) == ["vision"]


def test_an_error_is_logged_and_said_once_in_a_while_by_kind(caplog: pytest.LogCaptureFixture) -> None:
    said: list[float] = []
    error_guard = ErrorGuard(said.append)

    def fail() -> None:
        raise RuntimeError("no")

    for now in (0.0, 1.0, 9.0, 11.0):
        with error_guard.survived("Judged", now):
            fail()
    with error_guard.survived("Applied", 11.0):
        fail()
    assert said == [0.0, 11.0, 11.0]
    assert error_guard.count == 5
    assert [record.levelno for record in caplog.records] == [logging.ERROR] * 3


def test_the_camera_s_rate_is_counted_over_the_last_seconds_and_anew_after_a_restart_of_vision() -> None:
    rate = FrameRate()
    assert rate.update(10.0, 100) is None
    assert rate.update(10.5, 105) is None
    assert rate.update(11.0, 110) == 10.0
    assert rate.update(11.2, 130) == 10.0, "asked twice in a second it says the same"
    for second in range(12, 40):
        counted = rate.update(float(second), 110 + 20 * (second - 11))
    assert counted == 20.0
    assert rate.update(41.0, 3) is None
    assert rate.update(42.0, 8) == 5.0
