"""Checks the link: autopilot, ground stations and signatures."""

from __future__ import annotations

import os
import time
from pathlib import Path

from companion.desk.check.autopilot import CHECK, LINK
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed, skipped, warned
from companion.wire.signing import DAY, ticks
from companion.wire.signing_store import NAME, SigningKeyError, newest_stored, read_key

FORWARDING, SIGNING = "forwarding", "signing"
_RECOVER = f"set its clock; if others are refused, stop the companion, delete {NAME}, and load the key again"
_OWNED = "stop it first, or give the check a way of its own with --link"


def check_link(rover: CheckedRover) -> list[CheckFinding]:
    """Check that an autopilot is heard on one of the connections."""
    if rover.leaves_link:
        told = rover.told("link")
        trouble, home = told.get("trouble"), told.get("autopilot")
        if trouble:
            return [failed(LINK, f"the companion that runs: {trouble}")]
        if not home:
            return [
                warned(LINK, "the companion that runs hears no autopilot: check [link] url, and its wire")
            ]
        return [passed(LINK, f"the companion that runs hears the autopilot on {home}")]
    asked = rover.asked
    silent = [finding for finding in asked.findings if finding.check == LINK]
    return [*silent, passed(LINK, f"{asked.url}: an autopilot is heard")] if asked.heard else silent


def check_autopilot(rover: CheckedRover) -> list[CheckFinding]:
    """Check the autopilot's parameters that would make a hold unsafe or useless."""
    if rover.leaves_link:
        state = (rover.running or {}).get("state", "unknown")
        return [skipped(CHECK, f"not asked: the companion runs (state {state}) and owns the link: {_OWNED}")]
    if not rover.asked.heard:
        return [skipped(CHECK, "not asked: none is heard, see the row link")]
    return [finding for finding in rover.asked.findings if finding.check != LINK]


def check_forwarding(rover: CheckedRover) -> list[CheckFinding]:
    """Check that a ground station is heard through the link, and may answer calls."""
    if rover.leaves_link:
        tested = rover.told("test_call")
        if tested.get("state") == "answered":
            return [passed(FORWARDING, str(tested.get("text", "a test call was answered")))]
        return [
            skipped(FORWARDING, "not tested: `companion check --dry-run` raises a test call for the ground")
        ]
    asked = rover.asked
    if not asked.heard:
        return [skipped(FORWARDING, "not known: no autopilot is heard, see the row link")]
    first, last = rover.config.link.allowed_senders
    named = ", ".join(f"{system}/{component}" for system, component in asked.grounds[:4])
    if any(first <= system <= last for system, _ in asked.grounds):
        return [passed(FORWARDING, f"ground station {named} is heard here")]
    if named:
        wrong = f"{named} is heard here, and may not answer: add it to [link] allowed_senders"
        return [warned(FORWARDING, f"ground station {wrong}")]
    what = (
        "no ground station is heard here: connect one, and let autopilot or router forward between the ports"
    )
    return [warned(FORWARDING, f"{what} (docs/autopilots.md)")]


def check_signing(rover: CheckedRover) -> list[CheckFinding]:
    """Check that frames are signed, and that the key can be read and fits."""
    key = rover.config.link.signing_key
    if key is None:
        return [warned(SIGNING, "off: whoever reaches the radio can answer calls: see [link] signing_key")]
    if rover.running is not None:
        return [_signing_of_running(rover, key)]
    # A key that exists and cannot be read belongs to the service's user: only the daemon can check it.
    if os.path.exists(key) and not os.access(key, os.R_OK):
        return [skipped(SIGNING, f"{key} may only be read by the service's user: type this with sudo")]
    try:
        read_key(Path(key))
    except SigningKeyError as error:
        return [failed(SIGNING, str(error))]
    if (ahead := _days_ahead(rover.folder)) > 1.0:
        text = f"a frame was received that was signed {ahead:.0f} days ahead of this clock: {_RECOVER}"
        return [warned(SIGNING, text)]
    if rover.asked.heard:
        return [passed(SIGNING, f"{key} is read, and the autopilot is heard with it")]
    return [passed(SIGNING, f"{key} is read; whether the autopilot has it is not known")]


def _days_ahead(folder: Path) -> float:
    """Return by how many days the newest stored timestamp is ahead of the clock."""
    try:
        return (newest_stored(folder) - ticks(time.time())) / DAY
    except OSError:  # the row of the journal tells it
        return 0.0


def _signing_of_running(rover: CheckedRover, key: str) -> CheckFinding:
    rejected = rover.told("link").get("rejected")
    counts = rejected if isinstance(rejected, dict) else {}
    refused = {why: counts[why] for why in ("unsigned", "signature", "replay", "ahead") if counts.get(why)}
    if refused:
        listed = ", ".join(f"{why} {number}" for why, number in refused.items())
        text = f"frames were refused since the start ({listed}): see its log for the sender"
        clock = (
            f"; if a station's clock was ahead once: {_RECOVER}"
            if refused.keys() & {"replay", "ahead"}
            else ""
        )
        return warned(SIGNING, text + clock)
    return passed(SIGNING, f"the companion that runs signs with {key}, and refused no frame")
