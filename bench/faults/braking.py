"""The row of a hold that brakes first: something happens in each of its steps."""

from __future__ import annotations

from bench.faults.row import Row
from bench.faults.stages import repeated
from bench.stopping.braking import BRAKING, FAULTS, STEPS

ROWS = (
    Row(
        "in the steps of a brake",
        'hold_by = "brake", the camera is frozen; as HOLD is asked for, in the brake, or as HOLD is set: a '
        "go, MANUAL, somebody's target, SIGKILL of the companion, or 0.6 s of lost frames one way",
        "it stands; a go drives on; MANUAL stays",
        repeated(len(STEPS) * len(FAULTS), *BRAKING),
    ),
)
