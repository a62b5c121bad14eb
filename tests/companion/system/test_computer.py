"""What is read of a computer, from files as Linux writes them; what it does not tell is None."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.system.computer import Computer

STAT = "cpu  {user} 0 100 {idle} 50 0 0 0 0 0\ncpu0 1 2 3 4\n"
MEMORY = "MemTotal:        4000000 kB\nMemFree: 100 kB\nMemAvailable:     512000 kB\n"
FIRMWARE = "sys/devices/platform/soc/soc:firmware/get_throttled"


def write(root: Path, **files: str) -> None:
    """`files`: name of a known file -> content."""
    for name, content in files.items():
        path = root / PLACES.get(name, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)


PLACES = {
    "stat": "proc/stat",
    "memory": "proc/meminfo",
    "hot": "sys/class/thermal/thermal_zone0/temp",
    "hotter": "sys/class/thermal/thermal_zone1/temp",
    "cooler": "sys/class/thermal/cooling_device0/type",
    "cooling": "sys/class/thermal/cooling_device0/cur_state",
    "fan": "sys/class/thermal/cooling_device1/type",
    "fanning": "sys/class/thermal/cooling_device1/cur_state",
    "firmware": FIRMWARE,
}


def measured(root: Path, **files: str) -> dict[str, Any]:
    write(root, **files)
    return Computer(root, root).measure()


def test_the_hottest_sensor_counts_and_one_that_cannot_be_right_does_not(tmp_path: Path) -> None:
    assert measured(tmp_path, hot="61250\n", hotter="48000\n")["temperature"] == 61.2
    assert measured(tmp_path, hotter="-274000\n")["temperature"] == 61.2
    assert measured(tmp_path, hot="rubbish", hotter="999000")["temperature"] is None


@pytest.mark.parametrize(
    ("files", "throttled", "under_voltage"),
    [
        ({}, None, None),
        ({"cooler": "thermal-cpufreq-0\n", "cooling": "0\n"}, False, None),
        ({"cooler": "thermal-cpufreq-0\n", "cooling": "2\n"}, True, None),
        ({"cooler": "Processor\n", "cooling": "1\n"}, True, None),
        ({"fan": "pwm-fan\n", "fanning": "3\n"}, None, None),
        ({"firmware": "0\n"}, False, False),
        ({"firmware": "50005\n"}, True, True),
        ({"firmware": "50000\n"}, False, False),
        ({"firmware": "0x1\n"}, False, True),
        ({"firmware": "rubbish\n"}, None, None),
    ],
)
def test_throttling_is_read_where_it_is_told(
    tmp_path: Path, files: dict[str, str], throttled: bool | None, under_voltage: bool | None
) -> None:
    told = measured(tmp_path, **files)
    assert (told["throttled"], told["under_voltage"]) == (throttled, under_voltage)


def test_the_load_is_that_since_the_measurement_before(tmp_path: Path) -> None:
    computer = Computer(tmp_path, tmp_path)
    write(tmp_path, stat=STAT.format(user=1000, idle=5000))
    assert computer.measure()["cpu"] is None
    write(tmp_path, stat=STAT.format(user=1030, idle=5070))
    assert computer.measure()["cpu"] == 0.3
    assert computer.measure()["cpu"] is None, "no time has passed"
    assert computer.newest["cpu"] is None


def test_memory_and_disk_are_told_in_mib(tmp_path: Path) -> None:
    told = measured(tmp_path, memory=MEMORY)
    assert (told["memory"], told["memory_free"]) == (3906, 500)
    assert 0 < told["disk_free"] <= told["disk"]
    assert Computer(tmp_path / "not/made/yet", tmp_path).measure()["disk"] == told["disk"]


def test_a_computer_that_tells_nothing_is_none_of_everything_but_the_disk(tmp_path: Path) -> None:
    told = measured(tmp_path)
    assert {name for name, value in told.items() if value is not None} == {"disk", "disk_free"}


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.sampled_from(sorted(PLACES)), st.text(max_size=30)))
def test_whatever_the_files_hold_the_figures_are_numbers_in_their_ranges(
    tmp_path_factory: pytest.TempPathFactory, files: dict[str, str]
) -> None:
    told = measured(tmp_path_factory.mktemp("root"), **files)
    assert told["temperature"] is None or -50 <= told["temperature"] <= 150
    assert told["cpu"] is None or 0 <= told["cpu"] <= 1
    assert told["throttled"] in (None, True, False)


def test_measuring_again_adds_nothing_to_the_interned_texts(tmp_path: Path, interned: list[str]) -> None:
    write(tmp_path, stat=STAT.format(user=1000, idle=5000), memory=MEMORY, hot="61250", firmware="0")
    computer = Computer(tmp_path, tmp_path)
    computer.measure()
    interned.clear()
    assert computer.measure()["temperature"] == 61.2
    assert interned == []


def test_this_computer_is_measured_in_milliseconds(tmp_path: Path) -> None:
    told = Computer(tmp_path).measure()
    assert told["memory_free"] > 0
    assert told["disk_free"] > 0
