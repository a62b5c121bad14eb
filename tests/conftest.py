"""What holds for all tests: the same examples on every machine, and no time limits on a busy one.

Tests marked `needs_export` compare with torch and transformers, a large download that `make test` can do
without: they are skipped where it is missing, but never in the gate (CI=true), where they fail.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("companion", deadline=None, derandomize=True)
settings.load_profile("companion")

os.environ.setdefault("OMP_NUM_THREADS", "1")  # torch's, which `pytest -n` would start on every core of each

SLOW = (
    "bench",
    "anytraverse/dense/test_dense_parity.py",
    "anytraverse/dense/test_dense_parity_published.py",
    "anytraverse/export",
    "anytraverse/test_ground_perceiver.py",
    "anytraverse/training",
    "companion/pages/test_turned_signs.py",
    "companion/cameras/test_network_cameras.py",
    "companion/cameras/test_pipe.py",
    "companion/daemon/test_clipseg_in_the_daemon.py",
    "companion/daemon/test_clipseg_on_the_field.py",
    "companion/daemon/test_no_secret_is_shown.py",
    "companion/daemon/test_run_from_start_to_end.py",
    "companion/daemon/test_what_is_kept_before_it_is_said.py",
    "companion/desk/drives/test_browser_desk.py",
    "companion/link/test_calls_over_a_lossy_radio.py",
    "companion/link/test_mutated_frames_fuzzed.py",
    "companion/link/test_stuck_devices.py",
    "companion/observers/live",
    "companion/desk/check/test_check_on_the_field.py",
    "companion/observers/recording/test_a_recorder_that_fails.py",
    "companion/sim/demo/test_demo_processes.py",
    "companion/sim/field/test_album.py",
    "companion/sim/field/test_field_camera.py",
    "companion/sim/field/test_field_process.py",
    "companion/sim/field/test_network_on_the_field.py",
    "companion/test_whole_thread.py",
    "companion/calls/test_any_sequence.py",
    "companion/daemon/settings/test_from_page.py",
    "companion/daemon/test_a_completed_mission.py",
    "companion/desk/check/test_zone.py",
    "companion/desk/drives/test_rehearsal.py",
    "companion/desk/ground/test_look_ground.py",
    "companion/link/test_mode_commands_any_sequence.py",
    "companion/observers/video",
    "companion/vision/test_processes.py",
    "companion/observers/page/test_a_page_that_fails.py",
    "companion/observers/page/test_beside_a_daemon.py",
    "companion/observers/page/test_answers_in_a_browser.py",
    "companion/observers/page/test_in_a_browser.py",
    "companion/observers/page/test_recordings_in_a_browser.py",
    "companion/observers/page/test_settings_in_a_browser.py",
    "gcs_plugin/console/test_in_a_browser.py",
    "gcs_plugin/console/test_rovers_in_a_browser.py",
    "gcs_plugin/console/test_unread_calls_in_a_browser.py",
    "gcs_plugin/console/test_served.py",
)
"""Folders and files of the tests that `make test` leaves to `make test-slow`: they wait for real processes
within limits that a busy computer breaks, train and compare networks, or take long. A single test of more
than some 1.2 s is marked where it stands."""
LONGEST = (
    "test_bench_stopping.py",
    "test_network_cameras.py",
    "test_whole_thread.py",
    "test_check_on_the_field.py",
    "test_processes.py",
    "test_calls_over_a_lossy_radio.py",
    "test_clipseg_on_the_field.py",
)
"""Workers begin with them, so that none of them runs last and alone. CLIPSeg wants all cores: when it begins,
the stopping test, whose rovers are held where vision starves, is nearly over."""
TESTS = Path(__file__).parent
EXPORT = ("torch", "transformers", "onnx", "PIL")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "needs_export: compares with what the extra `export` brings")
    config.addinivalue_line("markers", "slow: `make test-slow` runs it, see `SLOW`")
    if absent := [place for place in SLOW if not (TESTS / place).exists()]:
        raise pytest.UsageError(f"tests/conftest.py: SLOW names what is not there: {', '.join(absent)}")
    # Else each worker and each process that a test starts would compile what it imports: 0.8 s of a daemon's
    # first 1.1 s.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Import no slow file where none of its tests is to run: that took a quarter of the time to collect."""
    return True if config.option.markexpr == "not slow" and _is_slow(collection_path) else None


def _is_slow(path: Path) -> bool:
    place = path.relative_to(TESTS).as_posix()
    return any(place == one or place.startswith(f"{one}/") for one in SLOW)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Each worker begins at another place, so that a file is compiled in one of them, not in all."""
    report = yield
    worker = getattr(collector.config, "workerinput", None)
    if worker is not None and isinstance(collector, pytest.Dir):
        begin = len(report.result) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
        report.result[:] = report.result[begin:] + report.result[:begin]
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the slow tests. All workers have the tests in one order, which xdist wants."""
    for item in items:
        if _is_slow(item.path):
            item.add_marker(pytest.mark.slow)
    if not hasattr(config, "workerinput"):
        return
    order = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (order.get(item.path.name, len(order)), item.path))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("needs_export") is None:
        return
    missing = [name for name in EXPORT if find_spec(name) is None]
    if missing and os.environ.get("CI", "").lower() in ("true", "1"):
        pytest.fail(f"the gate needs {', '.join(missing)}: make ready-export", pytrace=False)
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: make ready-export")
