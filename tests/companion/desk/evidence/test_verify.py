"""A file of evidence may come from anybody: whatever differs is noticed, and rubbish is refused."""

from __future__ import annotations

import io
import json
import os
import stat
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.cli import main
from companion.desk.evidence.package import (
    DATA,
    MEMBERS,
    SIGNATURE,
    SIGNED,
    SIGNERS,
    SUMS,
    pack,
    sums_of,
)
from companion.desk.evidence.signature import SignatureError, allowed_signers, fingerprint, rover_key, sign
from companion.desk.evidence.verify import NotEvidenceError, verify
from tests.companion.desk.evidence.told import document, members


def repacked(content: Mapping[str, bytes], path: Path) -> Path:
    """Pack these members as ours are, others as they come."""
    if set(content) == set(MEMBERS):
        path.write_bytes(pack(content))
        return path
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as written:
        for name, each in content.items():
            written.writestr(name, each)
    return path


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_a_flipped_byte_in_any_member_is_noticed(
    package: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    whole = members(package)
    name = data.draw(st.sampled_from(MEMBERS))
    content = bytearray(whole[name])
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    path = repacked({**whole, name: bytes(content)}, tmp_path_factory.mktemp("flipped") / "it.zip")
    with pytest.raises((NotEvidenceError, SignatureError)):
        verify(path)


def test_each_bit_of_the_signature_counts(package: Path, tmp_path: Path) -> None:
    """Base64 has bits that nobody decodes: those of the last letters before the "="."""
    whole = members(package)
    ends = len(whole[SIGNATURE].rstrip(b"-END SIGNATUREH\n"))
    for place in range(ends - 6, ends):
        for bit in range(8):
            content = bytearray(whole[SIGNATURE])
            content[place] ^= 1 << bit
            with pytest.raises((NotEvidenceError, SignatureError)):
                verify(repacked({**whole, SIGNATURE: bytes(content)}, tmp_path / "it.zip"))


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_a_flipped_byte_of_the_file_is_noticed(
    package: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = bytearray(package.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.mktemp("flipped") / "it.zip"
    path.write_bytes(content)
    with pytest.raises((NotEvidenceError, SignatureError)):
        verify(path)


@given(content=st.binary(max_size=400))
def test_rubbish_is_refused(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("rubbish") / "it.zip"
    path.write_bytes(content)
    with pytest.raises(NotEvidenceError):
        verify(path)


def refused(path: Path, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["evidence", "--verify", str(path)])
    told = "".join(capsys.readouterr())
    assert (code, said in told) == (1, True), told


@pytest.mark.parametrize("name", MEMBERS)
def test_a_missing_member_is_named(
    name: str, package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    left = {each: content for each, content in members(package).items() if each != name}
    refused(repacked(left, tmp_path / "it.zip"), f"{name} missing", capsys)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("more.html", "'more.html' is in it"),
        ("../evil.sh", "'../evil.sh' is in it"),
        ("a\x1b[2Jb", "'a\\x1b[2Jb' is in it"),
    ],
)
def test_a_member_that_was_added_is_named(
    name: str, said: str, package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(repacked({**members(package), name: b"x"}, tmp_path / "it.zip"), said, capsys)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_name_that_comes_twice_is_refused(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = repacked(members(package), tmp_path / "it.zip")
    with zipfile.ZipFile(path, "a") as written:
        written.writestr(DATA, b"{}")
    refused(path, "a member is in it twice", capsys)


def test_what_is_larger_than_any_evidence_is_not_read(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as written:
        for name, content in members(package).items():
            written.writestr(name, bytes(60_000_000) if name == DATA else content)
    assert (tmp_path / "bomb.zip").stat().st_size < 1_000_000
    refused(tmp_path / "bomb.zip", "it is packed otherwise", capsys)
    large = tmp_path / "large.zip"
    with large.open("wb") as file:
        file.truncate(30_000_000)
    refused(large, "it is larger than 20 MB", capsys)


def tailed(content: bytes) -> bytes:
    return content[:-1] + b"\x07"  # the comment's length


def gapped(content: bytes) -> bytes:
    directory = zipfile.ZipFile(io.BytesIO(content)).start_dir
    end = (directory + 6).to_bytes(4, "little")
    return content[:directory] + b"HIDDEN" + content[directory:-6] + end + content[-2:]


def linked(content: bytes) -> bytes:
    place = content.find(b"PK\x01\x02") + 38
    return content[:place] + (0o120777 << 16).to_bytes(4, "little") + content[place + 4 :]


@pytest.mark.parametrize(
    "change",
    [
        lambda content: b"#!/bin/sh\n" + content,
        lambda content: content + b"more",
        tailed,
        gapped,
        linked,
    ],
)
def test_what_another_program_may_read_otherwise_is_refused(
    change: Callable[[bytes], bytes], package: Path, tmp_path: Path
) -> None:
    path = tmp_path / "it.zip"
    path.write_bytes(change(package.read_bytes()))
    with pytest.raises(NotEvidenceError):
        verify(path)


def test_what_is_no_regular_file_is_not_waited_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / "pipe.zip")
    for path in (tmp_path / "pipe.zip", tmp_path, tmp_path / "nowhere.zip"):
        assert main(["evidence", "--verify", str(path)]) == 2
        said = "".join(capsys.readouterr())
        assert str(path) in said
        assert "sudo" not in said


def signed(key: Path, content: Mapping[str, bytes]) -> dict[str, bytes]:
    sums = sums_of({name: content[name] for name in SIGNED})
    return {**content, SUMS: sums, SIGNATURE: sign(key, sums)}


def test_who_signs_anew_has_another_key(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The signature is good, as its own: only the fingerprint tells who it was."""
    key, path, whole, told = rover_key(tmp_path), tmp_path / "it.zip", members(package), document(package)
    signers = allowed_signers(key)
    forged = {**whole, SIGNERS: signers.encode()}
    refused(repacked(signed(key, forged), path), "names another key", capsys)
    lie = {**told, "rover": "system 9\x1b[2J", "key": fingerprint(signers)}
    forged[DATA] = json.dumps(lie).encode()
    assert main(["evidence", "--verify", str(repacked(signed(key, forged), path))]) == 0
    said = capsys.readouterr().out
    assert told["key"] not in said
    assert "\x1b" not in said
    with_old_name = {**forged, SIGNERS: whole[SIGNERS]}
    refused(repacked(signed(key, with_old_name), path), "the signature is not good", capsys)


def test_signers_that_stand_for_anybody_are_refused(package: Path, tmp_path: Path) -> None:
    whole = members(package)
    line = b"* " + whole[SIGNERS].split(b" ", 1)[1]
    path = repacked(signed(rover_key(tmp_path), {**whole, SIGNERS: line}), tmp_path / "it.zip")
    with pytest.raises(SignatureError, match="not one ed25519 key"):
        verify(path)


def test_a_link_to_it_is_followed_and_it_stays_as_it_is(package: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.zip"
    link.symlink_to(package)
    before = package.read_bytes()
    assert verify(link) == verify(package)
    assert package.read_bytes() == before
    assert stat.S_ISLNK(link.lstat().st_mode)
