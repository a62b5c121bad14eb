"""Tests that need the extra `export`: skipped by a developer who lacks it, failed by the gate."""

from __future__ import annotations

import importlib
from types import SimpleNamespace
from typing import Any

import pytest


@pytest.fixture
def conftest(monkeypatch: pytest.MonkeyPatch) -> Any:
    module = importlib.import_module("tests.conftest")
    monkeypatch.setattr(module, "EXPORT", ("json", "no_such_package"))
    return module


def item(*markers: str) -> Any:
    return SimpleNamespace(get_closest_marker=lambda name: name if name in markers else None)


def test_without_the_extra_they_are_skipped_with_what_to_type(
    conftest: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CI", raising=False)
    with pytest.raises(pytest.skip.Exception, match="needs no_such_package: make ready-export"):
        conftest.pytest_runtest_setup(item("needs_export"))


def test_in_the_gate_they_fail(conftest: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception, match="the gate needs no_such_package"):
        conftest.pytest_runtest_setup(item("needs_export"))


def test_the_others_run_anywhere(conftest: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CI", "true")
    conftest.pytest_runtest_setup(item())
