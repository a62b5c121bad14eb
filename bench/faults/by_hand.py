"""Rows in which a human acts round a hold; the bench that stops a rover plays the same scenes."""

from __future__ import annotations

from bench.faults.row import BACK_WITHIN, Row
from bench.faults.stages import repeated
from bench.stopping.scenes import SCENES

ROWS = (
    Row(
        "driven on over a fault",
        "the camera is frozen; 1.5 s after its hold was confirmed a human sets AUTO",
        "held again after 20 s or 10 m",
        repeated(5, *SCENES["driven_on"]),
        None,
        BACK_WITHIN,
    ),
    Row(
        "a human's mode in the moment of a resume",
        "a go; MANUAL is set up to 60 ms after the command to resume has left; by turns with and without the "
        "script",
        "stays in MANUAL; without the script it may be held again",
        repeated(10, *SCENES["mode_at_resume"]),
    ),
    Row(
        "mission complete",
        "the mission ends, ArduPilot stays in AUTO and stands; a call there, or as it still rolls; a go",
        "it stays where it is",
        repeated(10, *SCENES["mission_complete"]),
    ),
    Row(
        "serial device stuck",
        "the autopilot's port takes no byte; a go is given, a human sets MANUAL; then it takes all again",
        "no command to drive on leaves late",
        repeated(5, *SCENES["serial_stuck"]),
        None,
        BACK_WITHIN,
    ),
)
