import math
import re
from typing import Any

import pytest

from companion.config.link_settings import Address, ConnectionSettings, LinkSettingError, LinkSettings


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("udpin:0.0.0.0:14550", Address("udpin", "0.0.0.0", 14550)),
        ("udpout:localhost:14550", Address("udpout", "127.0.0.1", 14550)),
        ("tcp:127.0.0.1:5760", Address("tcp", "127.0.0.1", 5760)),
        ("serial:/dev/ttyAMA0:57600", Address("serial", "/dev/ttyAMA0", 57600)),
        ("serial:/dev/serial/by-id/usb-a:b:115200", Address("serial", "/dev/serial/by-id/usb-a:b", 115200)),
    ],
)
def test_a_link_is_named_by_its_url(url: str, address: Address) -> None:
    assert LinkSettings(url).address() == address


@pytest.mark.parametrize(
    "url", ["", "udp:127.0.0.1:1", "udpin:14550", "tcp:127.0.0.1:x", "/dev/ttyAMA0", "serial::9600"]
)
def test_another_url_is_refused_with_examples(url: str) -> None:
    with pytest.raises(LinkSettingError, match=r"udpin:0\.0\.0\.0:14550"):
        LinkSettings(url)


@pytest.mark.parametrize("url", ["tcp:rover.local:5760", "tcp:127.0.0.1:70000", "tcp:127.0.0.1:0"])
def test_names_and_impossible_ports_are_refused(url: str) -> None:
    with pytest.raises(LinkSettingError, match=r"no IPv4 address|not in 1\.\.65535"):
        LinkSettings(url)


@pytest.mark.parametrize(
    "wrong",
    [
        {"system_id": 0},
        {"system_id": 255},
        {"budget": 10.0},
        {"budget": float("nan")},
        {"asked_budget": -1.0},
        {"burst": 100.0},
        {"pace": -0.1},
        {"pace": 0.2},
        {"allowed_senders": (255, 245)},
        {"allowed_senders": (0, 255)},
    ],
)
def test_a_setting_that_cannot_work_is_refused_by_name(wrong: dict[str, Any]) -> None:
    with pytest.raises(LinkSettingError, match=next(iter(wrong))):
        LinkSettings("udpin:0.0.0.0:14550", **wrong)


@pytest.mark.parametrize("baud", [2400, 9600, 19200, 57600])
@pytest.mark.parametrize(
    "wrong", [{"budget": 0.0}, {"asked_budget": 0.0}, {"budget": 300, "asked_budget": 3e3}]
)
def test_budgets_that_fill_a_serial_line_are_refused_with_those_that_do_not(
    baud: int, wrong: dict[str, float]
) -> None:
    url = f"serial:/dev/ttyAMA0:{baud}"
    with pytest.raises(LinkSettingError, match=f"half of what {baud} baud carry") as refused:
        ConnectionSettings(url, **wrong)
    own, asked = map(float, re.findall(r"budget = ([\d.]+)", str(refused.value)))
    assert own + asked == baud / 20
    assert ConnectionSettings(url, budget=own, asked_budget=asked).most_budget == own
    assert ConnectionSettings("tcp:127.0.0.1:5760", **wrong).most_budget == math.inf


def test_a_serial_line_too_slow_for_any_budget_is_refused() -> None:
    with pytest.raises(LinkSettingError, match="too slow: 2400 baud"):
        LinkSettings("serial:/dev/ttyAMA0:1200")


def test_only_links_that_hear_the_autopilot_first_wait_for_it() -> None:
    assert LinkSettings("udpin:0.0.0.0:14550").waits_for_vehicle
    assert LinkSettings("serial:/dev/ttyAMA0:57600").waits_for_vehicle
    assert not LinkSettings("udpout:127.0.0.1:14550").waits_for_vehicle
    assert not LinkSettings("tcp:127.0.0.1:5760").waits_for_vehicle
