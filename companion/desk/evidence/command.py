"""Runs `companion evidence`: collects, signs and packs, or checks a file of somebody's."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

from companion.config import format_config, load_config, state_folder
from companion.desk.check.zone_file import utc_now
from companion.desk.evidence.collect import evidence, read_sources
from companion.desk.evidence.package import CONFIG, DATA, PAGE, write_package
from companion.desk.evidence.page import page
from companion.desk.evidence.signature import (
    EvidenceError,
    SignatureError,
    allowed_signers,
    fingerprint,
    rover_key,
)
from companion.desk.evidence.verify import NotEvidenceError, verify

_NICENESS = 10


def write(file: str, out: str | None, *, checks: bool = True) -> int:
    """Write the file. Returns 0. checks: whether `companion check` is run for it.

    Raises EvidenceError, ConfigError, OSError.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the check's process is ended, too
    os.setpriority(os.PRIO_PROCESS, 0, _NICENESS)
    path = Path(out or f"evidence-{utc_now()}.zip")
    # Both are known before what takes minutes.
    if os.path.lexists(path):
        raise EvidenceError(f"{path}: is there already: name another one with --out")
    if not os.access(path.parent, os.W_OK):
        raise EvidenceError(f"{path.parent} cannot be written: name another place with --out")
    loaded = load_config(file)
    key = rover_key(state_folder(loaded))
    signers = allowed_signers(key)
    mark = fingerprint(signers)
    sources = read_sources(loaded, file, checks=checks)
    told, config = evidence(sources, mark), format_config(loaded)
    members = {
        PAGE: page(told, config).encode("utf-8", "replace"),
        DATA: json.dumps(told, indent=1, allow_nan=False).encode(),
        CONFIG: config.encode(),
    }
    size = write_package(path, key, signers, members)
    count, lacking = sum(len(part["figures"]) for part in told["parts"].values()), len(told["unknown"])
    print(f"{path}: {count} figures, {size / 1e6:.2f} MB, signed by {mark}")
    if checks and sources.no_check:
        print(f"  without what companion check finds: {sources.no_check}")
    print(f"  {lacking} things are not known: evidence.html in it lists them, with what would tell each")
    print("  times, modes and the configuration are in it: look through it before you give it to others")
    return 0


def check(path: str) -> int:
    """Check a file, and say which key signed it. Returns 0, or 1 where it differs. Raises EvidenceError."""
    try:
        found = verify(Path(path))
    except NotEvidenceError as error:
        print(f"{path}: NOT as it was signed: {error}")
        return 1
    except SignatureError as error:
        print(f"{path}: NOT signed by a rover's key: {error}")
        return 1
    print(f"{path}: nothing has changed since it was signed")
    print(f"  rover  {found.rover}, {found.made}, as it says itself")
    print(f"  key    {found.fingerprint}")
    print(
        "  compare this line, and not what stands in the file, with an earlier file's or what its owner tells"
    )
    return 0
