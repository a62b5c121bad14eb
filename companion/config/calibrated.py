"""Puts a camera's calibration in force: view and aspect are those of the rectified picture."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

from companion.cameras.calibration import CalibrationError, LensCalibration, read_calibration
from companion.config.toml_file import Layer, Problem

_VIEW_OFF = 3.0
"""Degrees by which a configured view may differ from the calibrated one."""


def calibrate(main: Layer, sections: dict[str, Any], problems: list[Problem]) -> LensCalibration | None:
    """Read the configured calibration; None without one. Changes `sections`, and adds to `problems`."""
    camera, keys = sections["camera"], ("camera", "calibration")
    if camera.calibration is None:
        return None
    try:
        found = read_calibration(main.path.parent.absolute() / os.path.expanduser(camera.calibration))
    except CalibrationError as error:
        problems.append(main.problem(keys, str(error)))
        return None
    if camera.width and camera.height and (misfit := found.misfit(camera.width, camera.height)):
        problems.append(main.problem(keys, misfit))
    keys = ("camera", "view")
    if main.value(keys) == camera.view and abs(camera.view - found.view) > _VIEW_OFF:
        reason = f"[camera] calibration makes it {found.view:g}: take this line out, or calibrate again"
        problems.append(main.problem(keys, reason))
    sections["camera"] = replace(camera, view=found.view)
    sections["mount"] = replace(sections["mount"], aspect=round(found.aspect, 4))
    return found
