"""The client on pymavlink alone, which users copy, against a rover that drives and calls."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

EXAMPLE = Path(__file__).parents[2] / "docs" / "answer_from_python.py"


def test_the_client_written_from_the_specification_hears_sets_and_answers(
    stage: Any, start: Callable[..., Any]
) -> None:
    stage.wait_until_ok()
    client = start(str(EXAMPLE), str(stage.ground))
    client.wait_for("type go, stay, look")
    client.wait_for("{'state': 'ok'")
    client.ask_until("set AT_W_GRASS 0.75", "AT_W_GRASS = 0.75")  # once a heartbeat has come too
    client.ask("set AT_W_GRASS 7", "AT_W_GRASS = 0.75")
    client.ask("set AT_W_BUSH 1", ": repeat it to turn it")
    client.ask("get /nothing", "not done: NAK 10")
    client.ask("get /state.json", '"AT_THR_ROI"')
    client.ask("go", "stale")
    client.ask("command go", "MAV_RESULT 2")
    stage.control.start()
    client.wait_for("% calls")
    call = client.wait_for("'stage': 1")
    assert re.search(r"'reasons': [123],", call)
    client.ask("get /calls/1.json", '"unknown')
    client.ask_until("command stay", "MAV_RESULT 0")
    client.ask_until("stay", "'result': 'applied'")
    answered = client.ask("go rock -1", "'result': ")
    assert re.search(r"'(applied|not covered)'", answered)
