"""`anytraverse`: its commands, each imported only when it is chosen."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from anytraverse.cli import COMMANDS, main
from anytraverse.release import to_install

Out = pytest.CaptureFixture[str]


def loaded(*arguments: str) -> set[str]:
    """The modules that are imported by running the command."""
    script = (
        "import json, sys\nfrom anytraverse.cli import main\n"
        f"try:\n    main({list(arguments)!r})\nexcept SystemExit:\n    pass\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_help_needs_nothing_heavy() -> None:
    modules = loaded("--help")
    assert not {"numpy", "cv2", "onnxruntime", "torch"} & modules


def test_help_of_a_bundles_commands_needs_nothing_heavy() -> None:
    assert not {"onnxruntime", "torch", "onnx"} & loaded("bundle", "check", "--help")


def test_help_of_the_fit_needs_no_torch() -> None:
    assert not {"numpy", "cv2", "onnxruntime", "torch", "onnx"} & loaded("fit", "--help")


def test_every_command_is_listed(capsys: Out) -> None:
    for arguments, names in (
        (["--help"], ("look", "fit", "export", "bundle")),
        (["bundle", "-h"], ("check", "classes")),
    ):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 0
        said = capsys.readouterr().out
        assert all(f"    {name} " in said for name in names)


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments", [("calls", "--episode", "nowhere"), ("sweep", "nowhere", "--prompts", "grass: 1")]
)
def test_a_long_command_says_that_it_begins_before_anything_heavy_is_imported(arguments: list[str]) -> None:
    command = [sys.executable, "-X", "importtime", "-m", "anytraverse.cli", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    lines = done.stderr.splitlines()
    begins = lines.index(f"anytraverse {arguments[0]}: starting")
    heavy = {"numpy", "cv2", "onnxruntime", "anytraverse.engine", "anytraverse.evaluation"}
    assert not heavy & {line.rpartition("|")[2].strip() for line in lines[:begins]}
    assert heavy & {line.rpartition("|")[2].strip() for line in lines[begins:]}, "they are imported later"


@pytest.mark.parametrize("arguments", [[], ["bundle"], ["fly"], ["bundle", "fly"]])
def test_a_command_that_is_not_one_is_refused(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2


@pytest.mark.parametrize(("command", "extra"), [("look", "rover"), ("export", "export"), ("fit", "train")])
def test_a_missing_package_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: Out, command: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setitem(COMMANDS, command, ("needs torch", "torch"))
    assert main([command]) == 2
    assert capsys.readouterr().err == f"anytraverse {command}: needs torch: {to_install(extra)}\n"


def test_ctrl_c_ends_quietly(monkeypatch: pytest.MonkeyPatch, capsys: Out) -> None:
    def interrupted(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("anytraverse.look.run", interrupted)
    assert main(["look", "picture.png"]) == 130
    assert capsys.readouterr().err == ""


def test_what_is_missing_is_installed_by_the_python_that_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SUDO_USER", raising=False)
    monkeypatch.setattr(sys, "executable", "/home/me and you/bin/python")
    monkeypatch.setattr(os, "access", lambda path, _how: path == sys.prefix)
    told = "'/home/me and you/bin/python' -m pip install \"anytraverse-companion[rover]\""
    assert to_install("rover") == told
    monkeypatch.setenv("SUDO_USER", "me")
    assert to_install("rover") == f"sudo {told}", "the next command is typed without what this one had"
    monkeypatch.delenv("SUDO_USER")
    monkeypatch.setattr(os, "access", lambda _path, _how: False)
    assert to_install("rover") == f"sudo {told}"
