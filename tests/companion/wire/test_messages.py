import subprocess
import sys
from pathlib import Path

from companion.link.signing import PRIVATE_TELEMETRY
from companion.wire.messages import MESSAGES, NUMBERS, TABLE, TELEMETRY

ROOT = Path(__file__).resolve().parents[3]


def test_every_message_has_a_name_of_its_own() -> None:
    assert len(MESSAGES) == len(TABLE)


def test_what_the_companion_sends_has_a_priority_and_what_it_hears_has_none() -> None:
    for row in TABLE:
        assert (row.priority is not None) == row.direction.startswith("to "), row.name


def test_everything_to_the_ground_is_paid_from_a_budget() -> None:
    for row in TABLE:
        assert (row.bucket is not None) == (row.direction == "to ground"), row.name


def test_the_heartbeat_and_the_hold_go_first_then_the_call() -> None:
    order = sorted((row for row in TABLE if row.priority is not None), key=lambda row: row.priority or 0)
    assert [row.name for row in order][:8] == [
        "heartbeat",
        "hold",
        "resume",
        "guide",
        "target",
        "setpoint",
        "sticks",
        "call text",
    ]


def test_an_autopilot_that_may_be_unsigned_may_say_all_that_is_heard_of_it() -> None:
    assert PRIVATE_TELEMETRY == TELEMETRY, "whoever adds a row decides whether it must be signed"


def test_quiet_traffic_fits_the_default_budget_twice() -> None:
    count = {"heartbeat": 1, "summary": 1, "number": len(NUMBERS), "computer": 1}
    quiet = sum(n * MESSAGES[name].bytes / (MESSAGES[name].period or 1.0) for name, n in count.items())
    assert quiet == 21 + 64 + len(NUMBERS) * 27 / 2 + 252 / 30
    assert 2 * quiet < 300


def test_the_wire_needs_nothing_heavy() -> None:
    code = (
        "import sys, companion.wire.messages, companion.wire.texts, companion.wire.parameters, "
        "companion.wire.answers; print({'numpy', 'cv2', 'pymavlink'} & set(sys.modules))"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT, timeout=30
    )
    assert printed.stdout.strip() == "set()"
