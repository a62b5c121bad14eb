"""A file of evidence may come from anybody: whatever differs is noticed, and rubbish is refused."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.cli import main
from companion.desk.evidence.package import DATA, SIGNATURE, SIGNED, SIGNERS, SUMS, sums_of
from companion.desk.evidence.signature import SignatureError, allowed_signers, rover_key, sign
from companion.desk.evidence.verify import NotEvidenceError, verify

MEMBERS = (*SIGNED, SUMS, SIGNATURE)


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as packed:
        return {name: packed.read(name) for name in packed.namelist()}


def packed(content: Mapping[str, bytes], path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as written:
        for name, each in content.items():
            written.writestr(name, each)
    return path


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
    path = packed({**whole, name: bytes(content)}, tmp_path_factory.mktemp("flipped") / "it.zip")
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
                verify(packed({**whole, SIGNATURE: bytes(content)}, tmp_path / "it.zip"))


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_a_flipped_byte_of_the_file_is_noticed_or_changes_no_member(
    package: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = bytearray(package.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.mktemp("flipped") / "it.zip"
    path.write_bytes(content)
    try:
        verify(path)
    except (NotEvidenceError, SignatureError):
        return
    assert members(path) == members(package)


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
    refused(packed(left, tmp_path / "it.zip"), f"{name} missing", capsys)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("more.html", "more.html is not in SHA256SUMS"),
        ("../evil.sh", "a member is called '../evil.sh'"),
        ("/etc/passwd", "a member is called '/etc/passwd'"),
        ("folder/", "a member is called 'folder/'"),
        ("a\x1b[2Jb", "a member is called 'a\\x1b[2Jb'"),
        (".hidden", "a member is called '.hidden'"),
    ],
)
def test_a_member_that_was_added_is_named(
    name: str, said: str, package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(packed({**members(package), name: b"x"}, tmp_path / "it.zip"), said, capsys)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_name_that_comes_twice_is_refused(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = packed(members(package), tmp_path / "it.zip")
    with zipfile.ZipFile(path, "a") as written:
        written.writestr(DATA, b"{}")
    refused(path, "evidence.json is in it 2 times", capsys)


def test_a_bomb_is_not_unpacked(package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = packed({**members(package), "bomb": bytes(60_000_000)}, tmp_path / "it.zip")
    assert path.stat().st_size < 1_000_000
    refused(path, "unpacked it is larger than 20 MB", capsys)


def test_a_bomb_that_lies_about_its_size_is_noticed(package: Path, tmp_path: Path) -> None:
    path = packed({**members(package), DATA: bytes(5_000_000)}, tmp_path / "it.zip")
    content = path.read_bytes()
    size = (5_000_000).to_bytes(4, "little")
    assert content.count(size) >= 2
    path.write_bytes(content.replace(size, (10).to_bytes(4, "little")))
    with pytest.raises(NotEvidenceError):
        verify(path)


def test_many_members_and_a_large_file_are_refused(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    many = {f"m{number}": b"" for number in range(40)}
    refused(packed({**members(package), **many}, tmp_path / "many.zip"), "it has 47 members", capsys)
    large = tmp_path / "large.zip"
    with large.open("wb") as file:
        file.truncate(30_000_000)
    refused(large, "it is larger than 20 MB", capsys)


def test_what_is_put_before_or_behind_it_is_noticed(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "it.zip"
    path.write_bytes(b"#!/bin/sh\n" + package.read_bytes())
    refused(path, "something stands before its first member", capsys)
    path.write_bytes(package.read_bytes() + b"more")
    refused(path, "something was added at its end", capsys)
    packed(members(package), path)
    with zipfile.ZipFile(path, "a") as written:
        written.comment = b"a comment"
    refused(path, "something was added at its end", capsys)


def test_what_is_no_regular_file_is_not_waited_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / "pipe.zip")
    for path in (tmp_path / "pipe.zip", tmp_path, tmp_path / "nowhere.zip"):
        assert main(["evidence", "--verify", str(path)]) == 2
        assert str(path) in "".join(capsys.readouterr())


def test_an_encrypted_member_is_refused(package: Path, tmp_path: Path) -> None:
    content = bytearray(package.read_bytes())
    for found in re.finditer(rb"PK\x01\x02", bytes(content)):
        content[found.start() + 8] |= 1
    path = tmp_path / "it.zip"
    path.write_bytes(content)
    with pytest.raises(NotEvidenceError, match="encrypted"):
        verify(path)


def test_who_signs_anew_has_another_key(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The signature is good, as its own: only the fingerprint tells who it was."""
    key = rover_key(tmp_path)
    told = json.loads(members(package)[DATA])
    forged = {name: members(package)[name] for name in SIGNED}
    forged |= {DATA: json.dumps({**told, "rover": "system 9\x1b[2J"}).encode()}
    forged |= {SIGNERS: allowed_signers(key).encode()}
    sums = sums_of(forged)
    path = packed({**forged, SUMS: sums, SIGNATURE: sign(key, sums)}, tmp_path / "it.zip")
    assert main(["evidence", "--verify", str(path)]) == 0
    said = capsys.readouterr().out
    assert told["key"] not in said
    assert "\x1b" not in said
    with_old_name = {**forged, SIGNERS: members(package)[SIGNERS]}
    sums = sums_of(with_old_name)
    packed({**with_old_name, SUMS: sums, SIGNATURE: sign(key, sums)}, path)
    refused(path, "the signature is not good", capsys)


def test_signers_that_stand_for_anybody_are_refused(package: Path, tmp_path: Path) -> None:
    whole = members(package)
    line = b"* " + whole[SIGNERS].split(b" ", 1)[1]
    changed = {**{name: whole[name] for name in SIGNED}, SIGNERS: line}
    path = packed({**changed, SUMS: sums_of(changed), SIGNATURE: whole[SIGNATURE]}, tmp_path / "it.zip")
    with pytest.raises(SignatureError, match="not one ed25519 key"):
        verify(path)


def test_a_link_to_it_is_followed_and_it_stays_as_it_is(package: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.zip"
    link.symlink_to(package)
    before = package.read_bytes()
    assert verify(link) == verify(package)
    assert package.read_bytes() == before
    assert stat.S_ISLNK(link.lstat().st_mode)


def test_it_may_be_packed_again(package: Path, tmp_path: Path) -> None:
    """What counts are the members: a mail program may pack them anew."""
    assert verify(packed(members(package), tmp_path / "again.zip")) == verify(package)
    shutil.copy(package, tmp_path / "copy.zip")
    assert io.BytesIO((tmp_path / "copy.zip").read_bytes()).getvalue() == package.read_bytes()
