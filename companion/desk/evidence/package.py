"""Writes the zip: members, their sums, and the rover's signature of the sums."""

from __future__ import annotations

import hashlib
import io
import shlex
import zipfile
from collections.abc import Mapping
from pathlib import Path
from textwrap import fill

from companion.desk.evidence.signature import EvidenceError, sign

LARGEST = 20_000_000
"""Bytes of the zip."""
PAGE, DATA, CONFIG, README = "evidence.html", "evidence.json", "config.toml", "README.txt"
SIGNERS, SUMS, SIGNATURE = "allowed_signers", "SHA256SUMS", "SHA256SUMS.sig"
SIGNED = (README, PAGE, DATA, CONFIG, SIGNERS)
"""The members that the sums list."""
MEMBERS = (*SIGNED, SUMS, SIGNATURE)
"""All members, in their order."""

PROVES = (
    "The signature proves that nothing in this file has changed since it was signed, and that two such files "
    "come from the same key. It does not prove that what they say is true."
)
README_TEXT = """Evidence of what a rover with the AnyTraverse companion has shown: open evidence.html.

evidence.html     all figures, for a person
evidence.json     the same, for a program
config.toml       the configuration, without secrets
allowed_signers   the rover's public key
SHA256SUMS        the sums of the files above
SHA256SUMS.sig    the rover's signature of the sums, by ssh-keygen

To check it, with coreutils and OpenSSH 8.2 or newer:

  unzip {name} -d evidence && cd evidence
  sha256sum --check --strict SHA256SUMS
  ssh-keygen -Y verify -f allowed_signers -I rover -n anytraverse-evidence -s SHA256SUMS.sig < SHA256SUMS

or, where the companion is installed, which also refuses what unzip might show otherwise:

  companion evidence --verify {name}

{proves}
Which key it was, only the output of these commands tells: compare that with what the owner told you, or with
that of an earlier file. What these files say of a key, anybody can write.
"""

_TIME = (1980, 1, 1, 0, 0, 0)
"""Of each member: that the members alone decide each byte of the zip."""
_UNIX = 3


def sums_of(members: Mapping[str, bytes]) -> bytes:
    """Return the sums as `sha256sum` writes them."""
    lines = (f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in members.items())
    return "".join(lines).encode()


def pack(members: Mapping[str, bytes]) -> bytes:
    """Return the zip with these members. The same ones are always packed the same."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_STORED) as written:
        for name in MEMBERS:
            entry = zipfile.ZipInfo(name, _TIME)
            entry.create_system, entry.external_attr = _UNIX, 0o644 << 16
            written.writestr(entry, members[name], zipfile.ZIP_STORED)
    return made.getvalue()


def write_package(out: Path, key: Path, signers: str, members: Mapping[str, bytes]) -> int:
    """Write the zip, and return its size in bytes.

    key: the private one. signers: as of `allowed_signers`. members: by name, without README, signers, sums
    and signature. Raises EvidenceError, OSError, FileExistsError where `out` is there already.
    """
    readme = README_TEXT.format(name=shlex.quote(out.name), proves=fill(PROVES, 100))
    all_signed = {**members, README: readme.encode(), SIGNERS: signers.encode()}
    signed = {name: all_signed[name] for name in SIGNED}
    sums = sums_of(signed)
    content = pack({**signed, SUMS: sums, SIGNATURE: sign(key, sums)})
    if len(content) > LARGEST:
        raise EvidenceError(f"it would be larger than {LARGEST // 1_000_000} MB")
    file = out.open("xb")
    try:
        with file:
            file.write(content)
    except BaseException:
        out.unlink(missing_ok=True)
        raise
    return len(content)
