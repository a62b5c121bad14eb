"""MAVSDK as a client, the example that users copy, and pymavlink's own file client."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
EXAMPLE = HERE.parents[1] / "docs" / "answer_from_mavsdk.py"


@pytest.fixture
def address(stage: Any) -> str:
    return str(stage.ground).replace("udpout:", "udpout://")


@pytest.fixture(scope="module")
def told(stage: Any, start: Callable[..., Any]) -> dict[str, Any]:
    stage.wait_until_ok()
    address = str(stage.ground).replace("udpout:", "udpout://")
    line = start(str(HERE / "mavsdk_client.py"), address, str(stage.out)).wait_for('{"numbers"')
    found: dict[str, Any] = json.loads(line)
    return found


def test_mavsdk_lists_and_sets_the_numbers(told: dict[str, Any]) -> None:
    numbers = told["numbers"]
    assert numbers["listed"]["AT_W_GRASS"] == 1.0
    assert numbers["listed"]["AT_POLICY"] == 2.0
    assert len(numbers["listed"]) >= 24
    assert numbers["set"] == 0.5


def test_mavsdk_is_told_no_when_a_number_is_out_of_range_or_unknown(told: dict[str, Any]) -> None:
    assert told["numbers"]["out of range"] != "SUCCESS"
    assert told["numbers"]["unknown"] == "TIMEOUT"


def test_mavsdk_reads_and_sets_the_words_as_text(told: dict[str, Any]) -> None:
    texts = told["texts"]
    assert texts["before"] == "grass: 0.5; dirt path: 1; bush: -1; tree: -1; sky: -1"
    assert texts["after"] == "grass: 0.5; dirt path: 1; bush: -0.5; tree: -1; sky: -1; gravel: 1"
    assert isinstance(texts["nonsense"], str)


def test_mavsdk_lists_files_and_is_told_what_is_missing(told: dict[str, Any]) -> None:
    assert isinstance(told["files"]["listing"], list)
    assert told["files"]["/no-such-file"] == "FILE_DOES_NOT_EXIST"


def test_pymavlinks_file_client_lists_and_is_told_what_is_missing(
    stage: Any, start: Callable[..., Any]
) -> None:
    told = json.loads(start(str(HERE / "mavftp_client.py"), stage.ground).wait_for('{"listed"'))
    assert told["listed"] == 0
    assert {"state.json", "calls", "maps", "logs"} <= set(told["names"])
    assert "grass" in told["state"]["words"]
    assert told["missing"] == 10, "FileNotFound"
    assert told["missing after"] < 5.0, "it always waits 3.7 s"


def test_the_example_shows_a_call_and_answers_it(stage: Any, address: str, start: Callable[..., Any]) -> None:
    example = start(str(EXAMPLE), address)
    example.wait_for("type go, stay, look")
    example.ask("AT_W_GRASS 0.75", "AT_W_GRASS = 0.75")
    example.ask("AT_W_BUSH 1", ": repeat it to turn it")
    example.ask("go", "go: denied")
    stage.control.start()
    example.wait_for("% calls")
    example.ask_until("stay", "stay: done")
