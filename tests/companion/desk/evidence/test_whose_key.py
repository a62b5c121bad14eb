"""The key belongs to the owner of the data folder: root signs with no other, and leaves none of its own."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from companion.desk.check.measure import _store
from companion.desk.evidence.signature import KEY, SignatureError, allowed_signers, rover_key, sign
from companion.vehicle.brakes import Measured

OWNER = 65534
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root has the rights of others")


@pytest.fixture
def theirs() -> Iterator[Path]:
    """A folder of the service's user, in one that everybody may enter, as pytest's own are not."""
    with TemporaryDirectory() as made:
        Path(made).chmod(0o755)
        folder = Path(made, "theirs")
        folder.mkdir()
        os.chown(folder, OWNER, OWNER)
        yield folder


def owners(folder: Path) -> set[int]:
    return {path.stat().st_uid for path in folder.rglob("*")}


@as_root
def test_what_root_makes_belongs_to_the_folders_owner(theirs: Path) -> None:
    key = rover_key(theirs / "state")
    assert b"BEGIN SSH SIGNATURE" in sign(key, b"x")
    _store(theirs / "measured" / "state", [Measured(1.0, 2.0)], [])
    assert len(list((theirs / "measured" / "state" / "stops").iterdir())) == 1
    assert owners(theirs) == {OWNER}


@as_root
@pytest.mark.parametrize("linked", [True, False])
def test_root_does_not_sign_with_a_key_of_its_own(theirs: Path, tmp_path: Path, linked: bool) -> None:
    own = rover_key(tmp_path / "root")
    if linked:
        (theirs / KEY).symlink_to(own)
    else:
        os.link(own, theirs / KEY)
    with pytest.raises((SignatureError, OSError)):
        rover_key(theirs)
    with pytest.raises(SignatureError):
        sign(theirs / KEY, b"x")
    with pytest.raises(SignatureError):
        allowed_signers(theirs / KEY)


@as_root
def test_a_key_of_another_user_is_not_used(tmp_path: Path) -> None:
    os.chown(rover_key(tmp_path), OWNER, OWNER)
    with pytest.raises(SignatureError, match="belongs to another user"):
        rover_key(tmp_path)


def test_a_pipe_in_place_of_the_key_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / KEY)
    with pytest.raises(OSError, match="no regular file"):
        rover_key(tmp_path)


def test_a_key_that_is_none_is_told_and_stays(tmp_path: Path) -> None:
    key = tmp_path / KEY
    key.write_text("rubbish")
    key.chmod(0o600)
    with pytest.raises(SignatureError, match="cannot be used: move it away"):
        allowed_signers(rover_key(tmp_path))
    assert key.read_text() == "rubbish"
    key.unlink()
    subprocess.run(["ssh-keygen", "-q", "-t", "ecdsa", "-N", "", "-f", str(key)], check=True)
    with pytest.raises(SignatureError, match="is no ed25519 key"):
        allowed_signers(rover_key(tmp_path))


def test_a_key_that_others_may_read_is_not_used(tmp_path: Path) -> None:
    rover_key(tmp_path).chmod(0o640)
    with pytest.raises(SignatureError, match=f"chmod 600 {tmp_path / KEY}"):
        rover_key(tmp_path)
