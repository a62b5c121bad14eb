"""MAVProxy as an operator has it: its own commands, then the module."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import Any

import pytest

from companion.wire.ids import Motion
from tests.gcs_plugin.conftest import THING_CALL, TinyRover

MODULE = "gcs_plugin.mavproxy_anytraverse"


@pytest.fixture(scope="module")
def proxy(stage: Any, mavproxy: Callable[..., Any]) -> Any:
    stage.wait_until_ok()
    proxy = mavproxy(stage.ground)
    proxy.wait_for("online system 1")  # which would set the target component back to the autopilot's
    proxy.type("set target_component 191")
    return proxy


def test_parameters_are_fetched_shown_and_set(proxy: Any) -> None:
    told = proxy.ask("param fetch", "Received ")
    assert told.endswith("(ftp)")
    assert int(re.findall(r"Received (\d+) parameters", told)[0]) >= 24
    assert "1.0" in proxy.ask("param show AT_W_GRASS", "AT_W_GRASS ")
    proxy.type("param set AT_W_GRASS 0.5")
    proxy.ask_until("param show AT_W_GRASS", "AT_W_GRASS       0.5")
    proxy.ask("param fetch", "Received ")
    assert proxy.ask("param diff AT_*", "AT_W_GRASS").split()[1:3] == ["0.500000", "1.000000"]


def test_parameters_are_fetched_message_by_message_too(proxy: Any) -> None:
    proxy.type("set param_ftp false")
    proxy.ask("param fetch", "Received ")
    proxy.type("set param_ftp true")


def test_parameters_are_not_waited_for(proxy: Any) -> None:
    begun = time.monotonic()
    proxy.ask("param fetch", "Received ")
    assert time.monotonic() - begun < 5.0, "an unanswered request costs MAVProxy eight seconds"


def test_the_answer_command_goes_by_both_of_its_spellings(proxy: Any) -> None:
    proxy.type("module load message")
    proxy.ask("long 31010 0 5 1 0 0 0 0", "COMMAND_ACK: USER_1: ACCEPTED")
    proxy.ask("message COMMAND_LONG 1 191 31010 0 0 5 2 0 0 0 0", "COMMAND_ACK: USER_1: ACCEPTED")
    proxy.ask("long 31010 0 9 0 0 0 0 0", "COMMAND_ACK: USER_1: DENIED")


def test_files_are_listed_and_one_that_is_missing_is_said_to_be(proxy: Any) -> None:
    proxy.ask("ftp list /", "Total size")
    proxy.ask("ftp get /no-such-file", "ftp open failed")


def test_the_module_tells_the_state_and_the_words(proxy: Any) -> None:
    proxy.ask(f"module load {MODULE}", f"Loaded module {MODULE}")
    proxy.wait_for("rover 1 companion heard")
    proxy.ask_until("at status", "rover 1: heard, companion ok")
    proxy.type("set target_component 1")
    proxy.ask_until("at words", "dirt path: 1; grass: 0.5")
    proxy.ask("at policy hold", "policy")


def test_a_call_is_told_and_answered_whatever_the_target_component(stage: Any, proxy: Any) -> None:
    stage.control.start()
    call = re.findall(r"C(\d+) unknown ", proxy.wait_for(" unknown "))[0]
    proxy.wait_for("at tap THING -1 go")
    assert not [line for line in proxy.said if 'says "C' in line], (
        "MAVProxy prints the companion's texts itself"
    )
    proxy.ask(f"at answer {call} tap drum -1, bush: -0.9, go", f"answer to {call} sent")
    assert re.search("done|does not cover", proxy.wait_for(f"answer to {call}: "))
    proxy.ask_until("at words", "bush: -0.9")


def test_the_module_is_reloaded_and_unloaded_by_its_name(proxy: Any) -> None:
    proxy.ask(f"module reload {MODULE}", f"Reloaded module {MODULE}")
    proxy.wait_for("rover 1 companion heard")
    proxy.ask(f"module unload {MODULE}", f"Unloaded module {MODULE}")
    proxy.ask("at status", "Unknown command 'at status'")


def test_two_rovers_on_two_links_in_the_dialect_of_ardupilot(
    mavproxy: Callable[..., Any], radio: Callable[..., Any]
) -> None:
    rovers = [TinyRover(system, THING_CALL) for system in (1, 2)]
    links = [radio(rover).address for rover in rovers]
    proxy = mavproxy(*links, options=("--dialect", "ardupilotmega", "--load-module", MODULE))
    for system in (1, 2):
        proxy.ask_until("at status", f"rover {system}: heard, companion CALLING")
    proxy.ask_until("at calls", "C7 unknown thing ahead")
    proxy.ask("at go", "rovers 1, 2 are heard")
    proxy.ask_until("at rover 2 go", "answer to 7: done", every=2.5)
    assert [rover.applied for rover in rovers] == [[], [(7, Motion.GO, ())]]
    assert not [line for line in proxy.said if "mistake in the module" in line]
