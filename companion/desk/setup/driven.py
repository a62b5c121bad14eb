"""Proposes the mount by what the rover has recorded of its own drives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from companion.config import Config, state_folder
from companion.desk.drives.drive import DriveError
from companion.desk.ground.mount_estimate import fitted
from companion.desk.ground.mount_fit import CannotTellError
from companion.observers.recording.ring import FOLDER, recordings
from companion.pages.requests import RequestError

LIMIT = 180.0
"""Seconds."""


def _folder(config: Config) -> Path:
    return state_folder(config) / FOLDER


def is_recorded(config: Config) -> bool:
    """Return whether there is a recording that may be read."""
    try:
        return bool(recordings(_folder(config)))
    except OSError:
        return False


def estimate(config: Config) -> dict[str, Any]:
    """Return height (m) and tilt (degrees) by the recordings: JSON values. Raises RequestError."""
    try:
        fit, pairs = fitted(config, str(_folder(config)))
    except (CannotTellError, DriveError, OSError) as error:
        raise RequestError(str(error)) from error
    low, height, high = fit.height
    flat, tilt, steep = fit.tilt
    return {
        "height": round(height, 2),
        "tilt": round(tilt, 1),
        "text": (
            f"By {fit.pairs} of {pairs} pairs of frames: height {height:.2f} m (half of them from "
            f"{low:.2f} to {high:.2f}), tilt {tilt:.1f} degrees ({flat:.1f} to {steep:.1f})."
        ),
    }
