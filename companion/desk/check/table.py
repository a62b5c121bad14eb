"""Lists all checks of `companion check`, in the order in which a person mends what they find."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from companion.desk.check.camera import check_camera, check_exposure, check_frames, check_infrared
from companion.desk.check.computer import (
    check_clock,
    check_heat,
    check_load,
    check_service,
    check_space,
    check_speed,
    check_versions,
)
from companion.desk.check.course import check_course
from companion.desk.check.here import check_journal
from companion.desk.check.link import check_autopilot, check_forwarding, check_link, check_signing
from companion.desk.check.live import check_live
from companion.desk.check.page import check_page
from companion.desk.check.perceiver import check_perceiver
from companion.desk.check.recording import check_recording
from companion.desk.check.rights import check_reach, check_rights
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed
from companion.desk.check.stopping import check_stopping, check_tile
from companion.desk.check.video import check_video


class Check(NamedTuple):
    """One row of the table. look: checks, and returns one finding or more. what: what it checks."""

    name: str
    look: Callable[[CheckedRover], Iterable[CheckFinding]]
    what: str


def _config(rover: CheckedRover) -> list[CheckFinding]:
    where = f"{rover.file}, " if rover.file else ""
    return [passed("config", f"{where}policy {rover.config.call.policy}")]


# fmt: off
CHECKS = (
    Check("config",     _config,          "whether the configuration is sound"),
    Check("versions",   check_versions,   "whether all packages are there, and the installed release runs"),
    Check("service",    check_service,    "whether systemd starts the companion at boot"),
    Check("rights",     check_rights,     "whether the service's users may use their files and devices"),
    Check("reach",      check_reach,      "what of the network the vision process reaches"),
    Check("disk",       lambda rover: [check_space(rover.folder)],
                                          "whether there is room for journal, pictures and logs"),
    Check("disk speed", check_speed,      "how long a write takes until it is on the disk"),
    Check("journal",    check_journal,    "whether what is learnt can be stored, and what is stored be read"),
    Check("clock",      check_clock,      "whether the clock was set, and runs on without power"),
    Check("heat",       check_heat,       "temperature, throttling, and the supply's voltage"),
    Check("load",       check_load,       "CPU and memory in use"),
    Check("camera",     check_camera,     "whether a first picture comes, shaped as `[mount] aspect` says"),
    Check("frames",     check_frames,     "how many pictures a second come, and how old they are"),
    Check("exposure",   check_exposure,   "whether the picture is too dark, too bright, or of one colour"),
    Check("infrared",   check_infrared,   "whether the camera has no infrared filter, and that is handled"),
    Check("perceiver",  check_perceiver,  "whether the model loads, and keeps the freshness limit T"),
    Check("link",       check_link,       "whether an autopilot is heard within 10 s, on any connection"),
    Check("autopilot",  check_autopilot,  "its parameters that would make a hold unsafe or useless"),
    Check("forwarding", check_forwarding, "whether a ground station is heard, and may answer"),
    Check("signing",    check_signing,    "whether frames are signed, and the key fits"),
    Check("course",     check_course,     "whether it would be seen that the vehicle drives backwards"),
    Check("stopping",   check_stopping,   "whether the vehicle stops within what its camera sees"),
    Check("tile",       check_tile,       "whether the vehicle fits into the ROI, and how large a tile is"),
    Check("page",       check_page,       "whether the page for a browser is shown, and to whom"),
    Check("video",      check_video,      "whether the MAVLink camera's video is served, and where"),
    Check("recording",  check_recording,  "whether recordings are written, where, and how many there are"),
    Check("live view",  check_live,       "whether the live view is served, and to whom"),
)
# fmt: on
WIDTH = 24


def findings(rover: CheckedRover) -> Iterator[CheckFinding]:
    """Run all checks in order. A check that fails in an unforeseen way is a finding, too."""
    for check in CHECKS:
        yield from _survived(check, rover)


def _survived(check: Check, rover: CheckedRover) -> Iterator[CheckFinding]:
    try:
        yield from check.look(rover)
    except Exception as error:  # the other checks still count
        what = f"{type(error).__name__}: {error}"
        yield failed(check.name, f"this check itself fails ({what[:200]}): report that")
