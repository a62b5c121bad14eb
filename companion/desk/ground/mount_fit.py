"""Estimates a camera's height and tilt from pairs of pictures between which the vehicle drove a known way.

Level ground that a mount explains is the same ground in both pictures: where the earlier one is warped by the
known motion, it looks like the later one. Only the ratio of height and way can be seen in pictures, so that
the height is as exact as the speed that the vehicle reported. Pure.
Source: Hartley and Zisserman, "Multiple View Geometry in Computer Vision", 2nd edition, section 13.1.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image
from anytraverse.ground import GroundCamera

FEWEST = 20
"""Pairs. From fewer, no mount is told."""
WIDEST_SPREAD = 1.5
"""Degrees. Where the middle half of the pairs' tilts is wider, no mount is told."""
_TILTS = np.arange(-5.0, 30.1, 1.5)
_HEIGHTS = np.exp(np.arange(math.log(0.2), math.log(3.05), 0.08))
_SEARCHED_BY = 24
"""Pairs by which the whole range of mounts is searched; all refine what is found."""
_ALIKE = 0.4
"""Correlation from which a pair counts: below, the ground is featureless, or no plane."""
_STANDS_OUT = 0.2
"""By which the best mount's mean correlation must exceed that of the middle one of all mounts."""
_ROUGH, _FINE = (2.5, 12.0), (1.0, 8.0)
"""Pixels of the blurs whose difference is compared: noise and light are left out."""
_WIDTH = 320
_SEEN = 0.6
"""Share of the compared places that must be in the earlier picture."""
_FLOOR = 0.62
"""Row from which every mount that is tried sees ground."""

_STEPS = 9
"""Steps of a refinement with each blur."""
_WAYS = [np.array(way) for way in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(way)]

Grey = NDArray[np.float32]
Floats = NDArray[np.float64]


class CannotTellError(Exception):
    """Reports that the pairs do not tell how the camera is mounted. The text says why, and what to do."""


@dataclass(frozen=True)
class FramePair:
    """Two pictures between which the vehicle drove.

    first, second: of `grey`. ahead: m driven. turned: degrees clockwise. pitched, banked: degrees by which
    its nose rose and its right side sank.
    """

    first: Grey
    second: Grey
    ahead: float
    turned: float = 0.0
    pitched: float = 0.0
    banked: float = 0.0


@dataclass(frozen=True)
class MountFit:
    """The mount that explains the pairs: quartile, median, quartile over `pairs` of them.

    height: in m. tilt: in degrees. likeness: the median of their correlations.
    """

    height: tuple[float, float, float]
    tilt: tuple[float, float, float]
    pairs: int
    likeness: float


def grey(picture: Image) -> Grey:
    """Return what a pair keeps of a picture."""
    height = round(picture.shape[0] * _WIDTH / picture.shape[1])
    small = cv2.resize(
        cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), (_WIDTH, height), None, 0, 0, cv2.INTER_AREA
    )
    return np.asarray(small, np.float32)


def fit_mount(pairs: Sequence[FramePair], camera: GroundCamera) -> MountFit:
    """Return the height and tilt that explain most pairs. Raises CannotTellError.

    camera: gives lens, roll and heading.
    """
    if len(pairs) < FEWEST:
        raise CannotTellError(f"{len(pairs)} pairs of frames can be used, and {FEWEST} are needed")
    found = _search(pairs, camera)
    places = _trapezoid(found)
    fitted = np.array([_refine(pair, found, places) for pair in pairs])
    used = fitted[fitted[:, 2] >= _ALIKE]
    if len(used) < FEWEST:
        raise CannotTellError(
            f"in {len(used)} of {len(pairs)} pairs the ground looks like a plane, and {FEWEST} are needed"
        )
    quartiles = np.percentile(used, [25, 50, 75], axis=0)
    tilt, height = (tuple(quartiles[:, column].tolist()) for column in (0, 1))
    if tilt[2] - tilt[0] > WIDEST_SPREAD:
        raise CannotTellError(
            f"the pairs disagree: half of the tilts lie from {tilt[0]:.1f} to {tilt[2]:.1f} degrees"
        )
    return MountFit(height, tilt, len(used), float(quartiles[1, 2]))


@dataclass(frozen=True)
class _Compared:
    """A pair, blurred; `there`: what the later picture shows at the compared places (3, n), homogeneous."""

    pair: FramePair
    earlier: Grey
    there: Grey
    places: Floats

    @classmethod
    def of(cls, pair: FramePair, blurs: tuple[float, float], places: Floats) -> _Compared:
        later = _band(pair.second, blurs)
        return cls(pair, _band(pair.first, blurs), _sampled(later, places[:2]), places)

    def likeness(self, camera: GroundCamera, turned: float) -> float:
        """Correlate the later picture with the earlier one, warped as a mount says; -1: not seen there."""
        pitch, bank = self.pair.pitched / 2, self.pair.banked / 2
        before, after = camera.leaning(-pitch, -bank), camera.leaning(pitch, bank)
        motion = _moved(self.pair.ahead, turned)
        warped = before.homography @ motion @ np.linalg.inv(after.homography) @ self.places
        depth = np.where(warped[2] > 0.0, warped[2], np.nan)
        found = warped[:2] / depth
        seen = ((found > 0.0) & (found < 1.0)).all(axis=0)
        if seen.mean() < _SEEN:
            return -1.0
        one, other = _sampled(self.earlier, found[:, seen]), self.there[seen]
        one, other = one - one.mean(), other - other.mean()
        return float(one @ other / math.sqrt(float(one @ one) * float(other @ other) + 1e-9))

    def of_mount(self, found: GroundCamera, at: Floats) -> float:
        """Correlate for a tilt, a logarithm of the height, and a turn."""
        return self.likeness(replace(found, tilt=float(at[0]), height=math.exp(at[1])), float(at[2]))


def _search(pairs: Sequence[FramePair], camera: GroundCamera) -> GroundCamera:
    """Return the mount that explains the pairs together best, of all that are tried."""
    every = math.ceil(len(pairs) / _SEARCHED_BY)
    places = _floor(camera)
    compared = [_Compared.of(pair, _ROUGH, places) for pair in pairs[::every]]
    alike = np.array(
        [
            [np.mean([one.likeness(mounted, one.pair.turned) for one in compared]) for mounted in row]
            for row in ([replace(camera, height=float(h), tilt=float(t)) for h in _HEIGHTS] for t in _TILTS)
        ]
    )
    tilt, height = np.unravel_index(int(alike.argmax()), alike.shape)
    if alike.max() - np.median(alike) < _STANDS_OUT:
        raise CannotTellError("no mount explains the pairs better than any other")
    if tilt in (0, len(_TILTS) - 1) or height in (0, len(_HEIGHTS) - 1):
        raise CannotTellError(
            f"the pairs ask for a mount beyond those that are tried, {_TILTS[0]:g} to {_TILTS[-1]:g} degrees "
            f"and {_HEIGHTS[0]:.1f} to {_HEIGHTS[-1]:.1f} m"
        )
    return replace(camera, height=float(_HEIGHTS[height]), tilt=float(_TILTS[tilt]))


def _refine(pair: FramePair, found: GroundCamera, places: Floats) -> tuple[float, float, float]:
    """Return the tilt and height that explain one pair best, near those that were found, and how well.

    The turn is refined, too: it comes from a compass.
    """
    at = np.array([found.tilt, math.log(found.height), pair.turned])
    likeness = -1.0
    for blurs, size in ((_ROUGH, [1.5, 0.08, 0.5]), (_FINE, [0.4, 0.03, 0.15])):
        compared, step = _Compared.of(pair, blurs, places), np.array(size)

        likeness = compared.of_mount(found, at)
        for _ in range(_STEPS):
            tried = [at + step * way for way in _WAYS]
            alike = [compared.of_mount(found, one) for one in tried]
            if max(alike) > likeness:
                likeness, at = max(alike), tried[int(np.argmax(alike))]
            else:
                step = step / 2
    return float(at[0]), math.exp(at[1]), likeness


def _floor(camera: GroundCamera) -> Floats:
    """Return places low in the picture, (3, n): every mount that is tried sees ground there."""
    places = _all_places(camera, 1 / 80)
    across, down, _ = places
    half = 0.2 + 0.6 * (down - _FLOOR)
    return places[:, (down > _FLOOR) & (np.abs(across - 0.5) < half)]


def _trapezoid(found: GroundCamera) -> Floats:
    """Return the places of the ground that is near enough to show a mount, (3, n)."""
    places = _all_places(found, 1 / 160)
    ahead, left = found.to_ground(places[:2].T).T
    reach = max(found.height, 0.6)
    return places[:, (ahead > 1.2 * found.height) & (ahead < 5.0 * reach) & (np.abs(left) < 1.5 * reach)]


def _all_places(camera: GroundCamera, step: float) -> Floats:
    """Return places all over the picture, homogeneous, (3, n). step: share of its width between two."""
    aspect = camera.lens.focal_y / camera.lens.focal_x
    across, down = np.meshgrid(np.arange(0.02, 0.98, step), np.arange(0.02, 0.98, step * aspect))
    return np.stack([across.ravel(), down.ravel(), np.ones(across.size)])


def _band(picture: Grey, blurs: tuple[float, float]) -> Grey:
    noise, light = (cv2.GaussianBlur(picture, (0, 0), sigma) for sigma in blurs)
    return np.asarray(noise - light, np.float32)


def _sampled(picture: Grey, places: Floats) -> Grey:
    """Return what a picture shows at places (2, n), (n,)."""
    height, width = picture.shape
    across, down = (places * [[width], [height]] - 0.5).astype(np.float32)
    return np.asarray(cv2.remap(picture, across[None], down[None], cv2.INTER_LINEAR)[0], np.float32)


def _moved(ahead: float, turned: float) -> Floats:
    """Return where the ground of a vehicle that drove an arc was before, homogeneous, (3, 3)."""
    turn = math.radians(-turned)
    c, s = math.cos(turn), math.sin(turn)
    along, aside = ahead * math.cos(turn / 2), ahead * math.sin(turn / 2)
    return np.array([[c, -s, along], [s, c, aside], [0.0, 0.0, 1.0]])
