"""`companion evidence` as it is typed: what is in the file, and what is typed to check it."""

from __future__ import annotations

import os
import re
import subprocess
import time
from pathlib import Path

import pytest

from companion.cli import main
from companion.desk.evidence import collect
from companion.desk.evidence.package import PAGE, README
from companion.desk.evidence.signature import KEY
from companion.system.isolated import isolated
from tests.companion.desk.evidence.driven import ANSWERED_AFTER, SECRETS, SILENT_FOR, configured
from tests.companion.desk.evidence.told import document, figures, members, packed, table


def typed(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str]:
    code = main([*map(str, words)])
    return code, "".join(capsys.readouterr())


@pytest.mark.slow
def test_a_drive_becomes_figures_with_their_samples_and_times(package: Path) -> None:
    told = document(package)
    assert told["evidence"] == 1
    assert told["rover"] == "system 1"
    calls, camera, link = (figures(told["parts"][name]) for name in ("calls", "camera", "link"))
    assert calls["calls"] == calls["calls answered"] == calls["closed: answered"] == 1
    assert calls["from call to first answer, median"] == pytest.approx(ANSWERED_AFTER, abs=0.3)
    assert calls["holds"] >= 2, "of the call and of the fault"
    assert calls["of these, a mode of ours within 2 s"] == 0
    assert camera["times without a picture for 1 s"] == 1
    assert camera["source"] == "rtsp://camera.local/..."
    assert link["autopilot"] == "system 1, ArduPilot"
    for part in told["parts"].values():
        for one in part["figures"]:
            assert one["source"]
            assert one["samples"] is None or one["from"] is None or one["from"] <= one["to"]
    counted = [one["samples"] for one in told["parts"]["camera"]["figures"] if one["source"] == "recordings"]
    assert min(counted) > 20


def test_a_lost_camera_is_told_with_the_bounds_of_its_absence(package: Path) -> None:
    parts = document(package)["parts"]
    (lost,) = table(parts["camera"], "Times without a picture")
    assert lost["back after, s, at least"] <= SILENT_FOR <= lost["at most"] + 0.2
    assert lost["at most"] - lost["back after, s, at least"] <= 2.5
    faults = {one["fault"]: one for one in table(parts["faults"], "Kinds of faults")}
    seen = faults["no pictures from the camera"]
    assert seen["seen"] == 1
    assert SILENT_FOR - 2.0 <= seen["stood, at most, s"] <= SILENT_FOR + 1.0
    assert faults["camera frozen"]["seen"] == "not in this log"


def test_what_is_not_known_names_what_would_tell_it(package: Path) -> None:
    told = document(package)
    lacking = {one["what"]: one for one in told["unknown"]}
    assert lacking["how far it rolls after HOLD"]["command"] == "companion check --measure"
    assert lacking["where a thing before the rover is noticed"]["command"] == "companion check --zone"
    assert "metres" not in lacking["calls and operator's seconds per kilometre"]
    assert "are needed" in lacking["calls and operator's seconds per kilometre"]["why"]
    assert lacking["what companion check finds"]["why"] == "it was left out by --no-check"
    assert all(one["why"] and one["command"] for one in told["unknown"])


def test_no_secret_of_the_configuration_is_in_any_member(package: Path) -> None:
    content = b"".join(members(package).values()) + package.read_bytes()
    assert [secret for secret in SECRETS if secret.encode() in content] == []
    assert b"camera.local" in content


def test_the_commands_of_the_readme_check_it(package: Path, tmp_path: Path) -> None:
    readme = members(package)[README].decode()
    lines = [line.strip() for line in readme.splitlines() if line.startswith("  ")]
    commands = [line for line in lines if line.startswith(("sha256sum", "ssh-keygen"))]
    assert len(commands) == 2
    for name, content in members(package).items():
        (tmp_path / name).write_bytes(content)
    for command in commands:
        done = subprocess.run(
            ["sh", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    assert 'Good "anytraverse-evidence" signature for rover' in done.stdout
    assert "SHA256:" not in readme, "anybody can write one there"
    assert document(package)["key"] in done.stdout
    (tmp_path / "evidence.json").write_text("{}")
    changed = subprocess.run(["sh", "-c", commands[0]], cwd=tmp_path, capture_output=True, check=False)
    assert changed.returncode != 0


def test_verify_says_rover_time_and_key(package: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said = typed(capsys, "evidence", "--verify", package)
    told = document(package)
    assert code == 0
    assert f"rover  system 1, {told['made_at']}" in said
    assert told["key"] in said


def test_two_files_of_a_rover_have_one_key_which_its_owner_alone_reads(
    driven: Path, package: Path, tmp_path: Path
) -> None:
    out = tmp_path / "second.zip"
    assert packed(driven, out)["key"] == document(package)["key"]
    key = driven.parent / "state" / KEY
    assert key.stat().st_mode & 0o777 == 0o600
    assert not list(key.parent.glob(f".{KEY}-*"))
    assert b"PRIVATE" not in out.read_bytes()


def test_with_an_empty_data_folder_everything_is_unknown_and_it_is_signed(tmp_path: Path) -> None:
    told = packed(configured(tmp_path), tmp_path / "it.zip")
    lacking = {one["what"] for one in told["unknown"]}
    assert {
        "how the companion does",
        "the time from a picture's capture until it is judged",
        "what companion check finds",
        "which faults were seen",
        "which autopilot was heard",
        "calls in the journal",
        "how far it rolls after HOLD",
        "where a thing before the rover is noticed",
        "the model that judged",
    } <= lacking
    assert figures(told["parts"]["computer"])["memory"] >= 1


def test_a_rover_without_a_clock_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("time.time", lambda: 5.0)
    told = packed(configured(tmp_path), tmp_path / "it.zip")
    assert told["made_at"] == "1970-01-01T00:00:05Z"
    assert "when this was made" in {one["what"] for one in told["unknown"]}


def test_the_page_opens_without_a_network_and_without_scripts(package: Path) -> None:
    page = members(package)[PAGE].decode()
    assert "<script" not in page
    assert all(link.startswith("#") for link in re.findall(r'(?:src|href)="([^"]*)"', page))
    assert "://" not in page.replace("rtsp://", "")
    assert "It does not prove that what they say is true." in page
    for part in document(package)["parts"]:
        assert f'<a href="#{part}">' in page
        assert f'<h2 id="{part}">' in page


def test_a_file_that_is_there_is_not_overwritten(
    driven: Path, package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = package.read_bytes()
    code, said = typed(capsys, "evidence", "--no-check", driven, "--out", package)
    assert (code, "is there already: name another one with --out" in said) == (2, True)
    assert package.read_bytes() == before


def test_without_openssh_it_says_what_to_install(
    driven: Path,
    package: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    out = tmp_path / "none.zip"
    for words in (("--no-check", "--config", str(driven), "--out", str(out)), ("--verify", str(package))):
        code, said = typed(capsys, "evidence", *words)
        assert (code, "sudo apt install openssh-client" in said) == (2, True), said
    assert not out.exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_who_may_not_read_the_key_is_told_of_sudo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = configured(tmp_path)
    packed(config, tmp_path / "it.zip")
    (tmp_path / "state" / KEY).chmod(0)
    code, said = typed(capsys, "evidence", "--no-check", config, "--out", tmp_path / "other.zip")
    assert (code, "you may have to type this with sudo" in said) == (2, True)


def test_a_status_with_any_process_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "status.json").write_text(f'{{"pid": {10**27}}}')
    packed(configured(tmp_path), tmp_path / "it.zip")
    assert (tmp_path / "it.zip").exists()


def test_a_check_that_failed_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(collect, "run_check", lambda _file: ([], "it broke"))
    code, said = typed(capsys, "evidence", configured(tmp_path), "--out", tmp_path / "it.zip")
    assert (code, "without what companion check finds: it broke" in said) == (0, True)


@pytest.mark.slow
def test_told_to_stop_it_ends_its_check(tmp_path: Path) -> None:
    command = isolated("companion", "evidence", str(configured(tmp_path)), "--out", str(tmp_path / "it.zip"))
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL) as running:
        children = Path(f"/proc/{running.pid}/task/{running.pid}/children")
        until = time.monotonic() + 60.0
        while not (found := [Path("/proc", one) for one in children.read_text().split()]) or not any(
            b"--json" in (one / "cmdline").read_bytes() for one in found
        ):
            assert time.monotonic() < until
            time.sleep(0.02)
        running.terminate()
        assert running.wait(20.0)
    while any(one.exists() and (one / "cmdline").read_bytes() for one in found):
        assert time.monotonic() < until
        time.sleep(0.02)
    assert not (tmp_path / "it.zip").exists()
