"""Attacks the companion as a hostile neighbour would, on this computer alone.

answers, torrent, heartbeats, noise: floods of the link, with a real vision process, an open call and an
operator. gate: the rover's page without its token. identities: autopilot and operator without the key, and
what they said played back. clock: senders with the key, and a clock far ahead. files: paths that lead out
of what MAVLink FTP serves, and links that a part which was broken into could have left there. stations: a
rover that is hostile to the console and to the terminal client. camera: a hostile network camera. recordings:
a stranger's, at the desk. secrets: a camera's password, in 25 forms, looked for in all that a companion
prints, logs, records and packs.
Prints a line for each kind; the last line is one JSON object: worst_heartbeat_gap_s,
longest_without_judging_s, secrets, reached, and all figures by kind. Exit code 1: a promise was broken.
Run: make bench-attack, or python -m bench.attack [answers gate] [--quick]
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from bench.attack.camera import camera
from bench.attack.clock import clock
from bench.attack.files import files
from bench.attack.floods import RATES, flood
from bench.attack.gate import gate
from bench.attack.identities import identities
from bench.attack.outcome import AttackOutcome
from bench.attack.recordings import recordings
from bench.attack.secrets import secrets
from bench.attack.stations import stations

KINDS: Mapping[str, Callable[..., AttackOutcome]] = {
    **{name: partial(flood, name) for name in RATES},
    "gate": gate,
    "identities": identities,
    "clock": clock,
    "files": files,
    "stations": stations,
    "camera": camera,
    "recordings": recordings,
    "secrets": secrets,
}


def main() -> int:
    """Attack in each way that is named, print the figures; returns 1 where a promise was broken."""
    given = _arguments()
    logging.disable(logging.CRITICAL)
    outcomes: dict[str, AttackOutcome] = {}
    for name in given.kinds or KINDS:
        with tempfile.TemporaryDirectory(prefix="ata-") as folder:
            outcomes[name] = KINDS[name](Path(folder), quick=given.quick)
        print(f"{name}: {asdict(outcomes[name])}", flush=True)
    print(json.dumps(figures(outcomes)))
    return 0 if all(one.good for one in outcomes.values()) else 1


def figures(outcomes: Mapping[str, AttackOutcome]) -> dict[str, Any]:
    """Return the figures of all kinds as JSON values."""
    return {
        "worst_heartbeat_gap_s": max(one.gap for one in outcomes.values()),
        "longest_without_judging_s": max(one.blind for one in outcomes.values()),
        "secrets": sum(len(one.secrets) for one in outcomes.values()),
        "reached": sum(len(one.reached) for one in outcomes.values()),
        "kinds": {name: {**asdict(one), "good": one.good} for name, one in outcomes.items()},
    }


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.attack",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"{', '.join(KINDS)}; else all")
    parser.add_argument("--quick", action="store_true", help="each for seconds")
    given = parser.parse_args()
    if unknown := sorted(set(given.kinds) - KINDS.keys()):
        parser.error(f"there is no {unknown[0]}: give {', '.join(KINDS)}")
    return given


if __name__ == "__main__":
    sys.exit(main())
