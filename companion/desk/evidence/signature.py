"""Signs with the rover's own key, and checks a signature, by OpenSSH's ssh-keygen."""

from __future__ import annotations

import base64
import binascii
import contextlib
import hashlib
import os
import re
import subprocess
import tempfile
from pathlib import Path

from anytraverse.regular_file import open_regular
from companion.system.as_owner import as_owner

KEY = "evidence_key"
"""The rover's private key, in its data folder."""
NAMESPACE = "anytraverse-evidence"
SIGNER = "rover"
"""The name in `allowed_signers` that the key stands for."""
_SIGNERS = re.compile(rf'{SIGNER} namespaces="{NAMESPACE}" ssh-ed25519 [A-Za-z0-9+/]{{68}}\n', re.ASCII)
_BEGIN, _END = b"-----BEGIN SSH SIGNATURE-----", b"-----END SSH SIGNATURE-----"
_COLUMNS = 70
_PATIENCE = 20.0
_INSTALL = "ssh-keygen is not installed: sudo apt install openssh-client"


class EvidenceError(Exception):
    """The command cannot be carried out. The text says what to do."""


class SignatureError(EvidenceError):
    """Nothing can be signed, or a signature is not good. The text says what to do."""


def rover_key(folder: Path) -> Path:
    """Return the rover's private key; makes it, readable by its owner alone, where there is none.

    Root makes and reads it with the rights of the folder's owner. folder: the companion's state. Raises
    EvidenceError, OSError.
    """
    path = folder / KEY
    with as_owner(folder):
        if not os.path.lexists(path):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=f".{KEY}-", dir=folder) as made:
                new = Path(made, "key")
                _run("-q", "-t", "ed25519", "-N", "", "-C", NAMESPACE, "-f", str(new))
                with contextlib.suppress(FileExistsError):  # another command was faster
                    os.link(new, path)
        # Who may not read it is told so, and not to move it away.
        with os.fdopen(open_regular(path, follow=False), "rb") as file:
            state = os.fstat(file.fileno())
        if state.st_uid != os.geteuid():
            raise SignatureError(f"{path} belongs to another user: move it away, to have a new one")
        if state.st_mode & 0o077:
            raise SignatureError(f"{path} may be read by others: chmod 600 {path}")
    return path


def allowed_signers(key: Path) -> str:
    """Return the public key as a line for `ssh-keygen -Y verify`. Raises EvidenceError."""
    what = f"{key} cannot be used: move it away, to have a new one"
    with as_owner(key.parent):
        told = _run("-y", "-P", "", "-f", str(key), what=what)
    words = told.decode(errors="replace").split()
    line = f'{SIGNER} namespaces="{NAMESPACE}" {" ".join(words[:2])}\n'
    if not _SIGNERS.fullmatch(line):
        raise SignatureError(f"{key} is no ed25519 key: move it away, to have a new one")
    return line


def sign(key: Path, content: bytes) -> bytes:
    """Return the signature of some bytes, armoured. Raises EvidenceError."""
    with as_owner(key.parent):  # who put a link in its place cannot have root's own key used
        return _run("-Y", "sign", "-f", str(key), "-n", NAMESPACE, content=content)


def check(signers: bytes, signature: bytes, content: bytes) -> str:
    """Check that content was signed by the key in `signers`; return the key's fingerprint.

    signers: as of `allowed_signers`. Raises SignatureError for a signature that is not good, or that is
    written otherwise than ssh-keygen writes one.
    """
    if not _SIGNERS.fullmatch(signers.decode("ascii", "replace")):
        raise SignatureError("allowed_signers is not one ed25519 key of a rover")
    if not _is_armoured(signature):
        raise SignatureError("the signature is damaged")
    with tempfile.TemporaryDirectory(prefix="companion-") as folder:
        allowed, signed = Path(folder, "signers"), Path(folder, "signature")
        allowed.write_bytes(signers)
        signed.write_bytes(signature)
        asked = ("-f", str(allowed), "-I", SIGNER, "-n", NAMESPACE, "-s", str(signed))
        _run("-Y", "verify", *asked, content=content, what="the signature is not good")
    return fingerprint(signers.decode())


def fingerprint(signers: str) -> str:
    """Return the fingerprint of the key in `signers`, as of `allowed_signers`, as ssh-keygen prints it."""
    digest = hashlib.sha256(base64.b64decode(signers.rsplit(maxsplit=1)[-1])).digest()
    return f"SHA256:{base64.b64encode(digest).decode().rstrip('=')}"


def _is_armoured(signature: bytes) -> bool:
    """Whether this is one signature as ssh-keygen writes it: no byte may change unnoticed."""
    lines = signature.split(b"\n")
    try:
        blob = base64.b64decode(b"".join(lines[1:-2]), validate=True)
    except binascii.Error:
        return False
    text = base64.b64encode(blob)
    rows = [text[place : place + _COLUMNS] for place in range(0, len(text), _COLUMNS)]
    return lines == [_BEGIN, *rows, _END, b""]


def _run(*asked: str, content: bytes = b"", what: str = "ssh-keygen failed") -> bytes:
    """Run ssh-keygen, and return what it says. what: begins the error. Raises EvidenceError."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SSH_")}
    try:
        done = subprocess.run(
            ["ssh-keygen", *asked],
            input=content,
            capture_output=True,
            timeout=_PATIENCE,
            check=False,
            env={**environment, "LC_ALL": "C"},
            start_new_session=True,  # it can ask for a passphrase nowhere
        )
    except FileNotFoundError:
        raise EvidenceError(_INSTALL) from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SignatureError(f"{what}: {error}") from error
    if done.returncode:
        said = " ".join(done.stderr.decode(errors="replace").split())[:200]
        raise SignatureError(f"{what}{f' ({said})' if said else ''}")
    return done.stdout
