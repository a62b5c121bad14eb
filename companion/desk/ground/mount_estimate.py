"""Implements `companion look-ground --estimate`: proposes height and tilt from a drive with known motion."""

from __future__ import annotations

import sys

from anytraverse.ground import GroundCamera, Lens
from companion.config import Config, load_config
from companion.desk.ground.driven_pairs import driven_pairs
from companion.desk.ground.mount_fit import FEWEST, CannotTellError, MountFit, fit_mount

_ADVICE = (
    "drive straight on level, textured ground for a minute at about 1 m/s, with [recording] rate = 2 so that "
    "frames are at most 1.8 m apart"
)


def fitted(config: Config, where: str, speed: float | None = None) -> tuple[MountFit, int]:
    """Return the mount that explains a drive, and how many pairs of frames could be used.

    speed: as of `estimate`. Raises CannotTellError and DriveError.
    """
    pairs = driven_pairs(where, config.camera.rate, speed)
    if len(pairs) < FEWEST:
        raise CannotTellError(f"{len(pairs)} pairs of frames can be used, and {FEWEST} are needed: {_ADVICE}")
    height, width = pairs[0].first.shape
    lens = Lens.of_view(config.camera.view, width / height)
    mount = config.mount
    camera = GroundCamera(lens, 1.0, 0.0, roll=mount.roll, heading=mount.heading)
    return fit_mount(pairs, camera), len(pairs)


def estimate(where: str, *, file: str, speed: float | None) -> int:
    """Print what [mount] height and tilt explain a drive. Returns 0, or 1 where that cannot be told.

    speed: m/s at which it was driven straight, where no recording tells. Raises ConfigError and DriveError.
    """
    config = load_config(file)
    mount = config.mount
    try:
        fit, pairs = fitted(config, where, speed)
    except CannotTellError as error:
        print(f"companion look-ground: cannot tell: {error}", file=sys.stderr)
        return 1
    print(f"# {where}: {fit.pairs} of {pairs} pairs of frames, correlation {fit.likeness:.2f}")
    print("[mount]")
    for name, (low, middle, high), digits, of_it in (
        ("height", fit.height, 2, "m, as exact as the speed is: measure it, too"),
        ("tilt", fit.tilt, 1, "degrees"),
    ):
        around = f"half of the pairs from {low:.{digits}f} to {high:.{digits}f}"
        print(f"{name} = {middle:.{digits}f}  # {of_it}; {around}")
    if mount.height is not None and mount.tilt is not None:
        print(f"# configured are height = {mount.height:g} and tilt = {mount.tilt:g}")
    return 0
