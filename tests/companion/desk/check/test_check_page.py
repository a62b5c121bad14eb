"""What the check says of the page."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from anytraverse.release import to_install
from companion.config import Config
from companion.config.web import WebSection
from companion.desk.check import observers
from companion.desk.check.observers import check_page
from companion.desk.check.rover import CheckedRover
from companion.system.side_process import missing_packages


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observers, "missing_for_page", str)


def found(listen: str, running: Mapping[str, Any] | None = None, token: str = "") -> tuple[str, str]:
    rover = CheckedRover(replace(Config(), web=WebSection(listen, token)), "", Path(), running)
    (finding,) = check_page(rover)
    return finding.verdict.name, finding.text


def test_a_free_port_passes_and_it_is_said_who_will_see_it() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        verdict, text = found(f"127.0.0.1:{port}")
        assert verdict == "WARN"
        assert "address already in use" in text
        assert "set another [web] listen" in text
    verdict, text = found(f"127.0.0.1:{port}")
    assert (verdict, text) == (
        "PASS",
        f"127.0.0.1:{port} is free, and will show it to programs on this computer",
    )
    assert "whoever knows the token" in found(f"127.0.0.1:{port}", token="t" * 16)[1]


def test_an_address_that_is_not_this_computers_is_a_warning() -> None:
    assert found("192.0.2.1:0", token="t" * 16)[0] == "WARN"


@pytest.mark.parametrize(
    ("told", "verdict", "text"),
    [
        (
            {"url": "http://127.0.0.1:8191/", "trouble": ""},
            "PASS",
            "http://127.0.0.1:8191/ shows it to programs",
        ),
        ({"url": "", "trouble": "ended: SIGSEGV"}, "WARN", "it ended: SIGSEGV, and is tried again"),
        ({"url": "", "trouble": "starting"}, "SKIP", "not known yet"),
        ({}, "SKIP", "not known"),
    ],
)
def test_a_companion_that_runs_says_how_its_page_does(
    told: Mapping[str, Any], verdict: str, text: str
) -> None:
    seen = found("127.0.0.1:8191", {"web": told})
    assert seen[0] == verdict
    assert text in seen[1]


def test_missing_packages_are_named_with_what_to_type(monkeypatch: pytest.MonkeyPatch) -> None:
    absent = partial(missing_packages, {"nowhere": "uvicorn"}, "web")
    monkeypatch.setattr(observers, "missing_for_page", absent)
    verdict, text = found("127.0.0.1:8191")
    assert verdict == "WARN"
    assert text.startswith(f"uvicorn not installed: {to_install('web')}")
    assert found("") == ("PASS", 'off: [web] listen is ""')
