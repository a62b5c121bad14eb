"""Manual pages and completion, made from the parsers of the programs."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ("companion", "anytraverse", "anytraverse-console", "anytraverse-operator")


@pytest.fixture(scope="module")
def share(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("share")
    done = subprocess.run(
        [sys.executable, ROOT / "systemd/shell_files.py", folder], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return folder


def shown(page: Path) -> str:
    """What man shows of a page, in one line."""
    man = shutil.which("man") or pytest.skip("man is not on this machine")
    done = subprocess.run(
        [man, "--warnings", "-l", str(page)],
        capture_output=True,
        text=True,
        check=False,
        env={"MANWIDTH": "200", "PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8"},
    )
    assert (done.returncode, done.stderr) == (0, "")
    return " ".join(re.sub(".\b", "", done.stdout).split())


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS)
def test_man_shows_each_page_without_a_warning(share: Path, program: str) -> None:
    text = shown(share / f"man/man1/{program}.1")
    assert f"NAME {program} - " in text
    assert str(Path.home()) not in text, "a page is for everybody"


def test_the_pages_have_every_command_with_its_arguments(share: Path) -> None:
    text = shown(share / "man/man1/companion.1")
    assert "companion memory forget [-h] [--config FILE] N [N ...]" in text
    assert "/etc/anytraverse/companion.toml" in text
    assert "--precision" in shown(share / "man/man1/anytraverse.1")


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_each_shell_can_read_its_completion(share: Path, program: str, shell: str) -> None:
    found = shutil.which(shell) or pytest.skip(f"{shell} is not on this machine")
    files = {"bash": f"bash-completion/completions/{program}", "zsh": f"zsh/site-functions/_{program}"}
    done = subprocess.run([found, "-n", share / files[shell]], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("companion me", {"memory"}),
        ("companion memory for", {"forget"}),
        ("companion status --j", {"--json"}),
        ("companion status comp", {"companion.toml"}),
        ("anytraverse bundle ch", {"check"}),
        ("anytraverse look --prom", {"--prompts"}),
        ("anytraverse-console --con", {"--connect"}),
    ],
)
def test_bash_completes_commands_options_and_files(
    share: Path, tmp_path: Path, typed: str, expected: set[str]
) -> None:
    bash = shutil.which("bash") or pytest.skip("bash is not on this machine")
    (tmp_path / "companion.toml").touch()
    words = typed.split()
    script = f"""
        _filedir() {{ COMPREPLY+=($(compgen -f -- "${{COMP_WORDS[COMP_CWORD]}}")); }}
        . {share}/bash-completion/completions/{words[0]}
        COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; COMP_LINE='{typed}'; COMP_POINT={len(typed)}
        $(complete -p {words[0]} | sed 's/.*-F \\([^ ]*\\) .*/\\1/') {words[0]} {words[-1]} {words[-2]}
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(
        [bash, "--norc", "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert set(done.stdout.split()) == expected, done.stderr
