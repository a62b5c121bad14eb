"""Writes the zip: members, their sums, and the rover's signature of the sums."""

from __future__ import annotations

import hashlib
import shlex
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path
from textwrap import fill

from companion.desk.evidence.signature import NAMESPACE, SIGNER, sign

LARGEST = 20_000_000
"""Bytes of the zip, and of each member."""
PAGE, DATA, CONFIG, README = "evidence.html", "evidence.json", "config.toml", "README.txt"
SIGNERS, SUMS, SIGNATURE = "allowed_signers", "SHA256SUMS", "SHA256SUMS.sig"
SIGNED = (README, PAGE, DATA, CONFIG, SIGNERS)
"""The members that the sums list. The two others are the sums and their signature."""

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
  ssh-keygen -Y verify -f {signers} -I {signer} -n {namespace} -s {signature} < {sums}

or, where the companion is installed, which also refuses files that the sums do not list:

  companion evidence --verify {name}

{proves}
The key is this one, by its fingerprint: {fingerprint}
"""

_EARLIEST = (1980, 1, 1, 0, 0, 0)
"""No zip has an earlier time, and a rover without a clock begins in 1970."""


class PackageTooLargeError(Exception):
    """The zip would be larger than `LARGEST`."""


def sums_of(members: Mapping[str, bytes]) -> bytes:
    """Return the sums as `sha256sum` writes them."""
    lines = (f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in members.items())
    return "".join(lines).encode()


def write_package(out: Path, key: Path, signers: str, fingerprint: str, members: Mapping[str, bytes]) -> int:
    """Write the zip, and return its size in bytes.

    key: the private one. signers: as of `allowed_signers`. members: by name, without README, signers, sums
    and signature. Raises SignatureError, NoToolError, PackageTooLargeError, OSError, FileExistsError where
    `out` is there already.
    """
    readme = README_TEXT.format(
        name=shlex.quote(out.name),
        signers=SIGNERS,
        signer=SIGNER,
        namespace=NAMESPACE,
        signature=SIGNATURE,
        sums=SUMS,
        proves=fill(PROVES, 100),
        fingerprint=fingerprint,
    )
    signed = {README: readme.encode(), **members, SIGNERS: signers.encode()}
    sums = sums_of(signed)
    packed = {**signed, SUMS: sums, SIGNATURE: sign(key, sums)}
    if sum(map(len, packed.values())) > LARGEST:
        raise PackageTooLargeError(f"it would be larger than {LARGEST // 1_000_000} MB")
    now = max(time.gmtime(time.time())[:6], _EARLIEST)
    try:
        with out.open("xb") as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as written:
            for name, content in packed.items():
                entry = zipfile.ZipInfo(name, now)
                entry.external_attr = 0o644 << 16
                written.writestr(entry, content, zipfile.ZIP_DEFLATED)
    except FileExistsError:
        raise
    except BaseException:
        out.unlink(missing_ok=True)
        raise
    return out.stat().st_size
