"""Keeps what the newest pictures truly show, so that an onlooker can say what a box in one of them is."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import astuple
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.regions import Box
from companion.sim.field.control import FieldError
from companion.sim.field.motion import LEVEL, Tilt
from companion.sim.field.render import GROUND_KINDS, LABELS
from companion.sim.field.things import DEFAULT_SURPRISES, KINDS, World
from companion.sim.field.trail import TrailPose
from companion.sim.field.view import View

KEPT = 360
"""Pictures, the newest ones: half a minute of them."""
LEAST_SHARE = 0.1
"""What stands beside the path is what a box shows if it covers this share of the box."""
A_CORNER = 0.03
"""The same of a thing on the path: a box often has but a corner of what it is about."""
WIDER = 1.25
"""By so much a box is enlarged for that: it ends with the region of interest, where a thing may begin."""
LEAST_PART = 0.5
"""A thing also is if this share of its pixels in the picture is in the box: a far one is small."""
AHEAD_M = 4.0
"""Metres ahead of the rover: the kind of ground there is the one that it sees."""

Labels = NDArray[np.uint8]


class _Picture(NamedTuple):
    taken: float
    pose: TrailPose
    labels: Labels
    tilt: Tilt


class Album:
    """Takes in pictures as they are drawn; another thread may ask about them."""

    def __init__(self, world: World, k1: float = 0.0) -> None:
        """k1: of the camera's distortion, as of `View`."""
        self._world, self._k1 = world, k1
        self._pictures: deque[_Picture] = deque(maxlen=KEPT)

    def keep(self, taken: float, pose: TrailPose, labels: Labels, tilt: Tilt = LEVEL) -> None:
        """Take in a picture. taken: monotonic seconds. labels: (H, W) uint8, indices into `LABELS`."""
        self._pictures.append(_Picture(taken, pose, labels, tilt))

    def look(self, box: Box, at: float | None) -> dict[str, Any]:
        """Say what a box shows. at: monotonic seconds when the picture was taken, None for the newest.

        thing: the id of the thing, or its kind where it stands far away; None where the box shows ground.
        kind: of the thing or of the ground, "" for neither. surprise: whether the thing was put on the path.
        outline: the box of the thing, None where most of it is in the box, and for ground.
        patch: the patch of ground, None for a thing. zone: of the ground ahead of the rover.
        Raises FieldError where that picture is not kept.
        """
        pictures = list(self._pictures)
        if not pictures or (at is not None and at < pictures[0].taken - 1.0):
            raise FieldError("no picture of that time is kept: ask sooner")
        picture = pictures[-1] if at is None else min(pictures, key=lambda one: abs(one.taken - at))
        trail, pose = self._world.trail, picture.pose
        s, _ = trail.nearest(pose.x, pose.y)
        zone = trail.zone(s + AHEAD_M)
        kind = shown_kind(picture.labels, box.grown(WIDER))
        if kind not in DEFAULT_SURPRISES:
            kind = shown_kind(picture.labels, box)
        thing = patch = outline = None
        if kind in KINDS:
            outline = _outline(picture.labels, kind, box)
            thing = self._thing(kind, picture, box.grown(WIDER))
        elif kind:
            patch = self._patch(kind, picture, box)
        known = self._world.things.get(thing or "")
        surprise = known is not None and known.surprise
        return {
            "thing": thing,
            "kind": kind,
            "surprise": surprise,
            "outline": outline,
            "patch": patch,
            "zone": zone,
        }

    def _thing(self, kind: str, picture: _Picture, box: Box) -> str:
        """Return the id of the thing of a kind whose place in the picture is nearest, in its own widths."""
        row, column = _middle(picture.labels, kind, box)
        view, found = self._view(picture), list[tuple[float, str]]()
        for thing in list(self._world.things.values()):
            x, y, depth = view.project(picture.pose, thing.x, thing.y, thing.height / 2)
            if thing.kind == kind and not math.isnan(x):
                wide = view.focal * max(thing.radius, thing.length / 2) / depth
                found.append((math.hypot(x - column, y - row) / wide, thing.id))
        return min(found)[1] if found else kind

    def _patch(self, kind: str, picture: _Picture, box: Box) -> str:
        """Return the patch of ground in the box: its kind, its zone, and on which side of the path."""
        row, column = _middle(picture.labels, kind, box)
        pose, trail = picture.pose, self._world.trail
        metres = np.stack(self._view(picture).where(), axis=-1)
        rows, columns = np.nonzero(~np.isnan(metres[..., 0]))
        nearest = np.argmin(np.hypot(rows - int(row), columns - int(column)))
        ahead, left = map(float, metres[rows[nearest], columns[nearest]])
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        along, lateral = trail.nearest(pose.x + ahead * c - left * s, pose.y + ahead * s + left * c)
        on_path = abs(lateral) < float(trail.half_width(np.array(along)))
        side = "path" if on_path else "left" if lateral > 0 else "right"
        return f"{kind}, {trail.zone(along)}, {side}"

    def _view(self, picture: _Picture) -> View:
        height, width = picture.labels.shape
        return View(width, height, picture.tilt, self._k1)


def shown_kind(labels: Labels, box: Box) -> str:
    """Return the label of the thing that a box shows, else of the ground there, "" where it shows neither.

    labels: (H, W) uint8. It answers as a person who is asked about the box: a thing that may stand on a path
    comes first, then a thing beside it, then the ground. So a thing need not cover most of the box.
    """
    inside = np.bincount(labels[box.slices(*labels.shape)].ravel(), minlength=len(LABELS))
    everywhere = np.bincount(labels.ravel(), minlength=len(LABELS))
    whole = max(1, int(inside.sum()))
    seen = {name: (int(inside[n]), int(everywhere[n])) for n, name in enumerate(LABELS)}
    things = {
        name: count
        for name, (count, all_of_it) in seen.items()
        if name in KINDS
        and count
        and (
            count >= (A_CORNER if name in DEFAULT_SURPRISES else LEAST_SHARE) * whole
            or count >= LEAST_PART * all_of_it
        )
    }
    ground = {name: count for name, (count, _) in seen.items() if name in GROUND_KINDS and count}
    found = things or ground
    return max(found, key=lambda name: (name in DEFAULT_SURPRISES, found[name]), default="")


def _outline(labels: Labels, kind: str, box: Box) -> list[float] | None:
    """Return the box of the thing of a kind that a box shows most of, None where most of it is in the box.

    Things of a kind are told apart where the picture shows something else between them.
    """
    _, parts = cv2.connectedComponents((labels == LABELS.index(kind)).astype(np.uint8))
    counts = np.bincount(parts.ravel())
    about, inside = (
        np.bincount(parts[one.slices(*labels.shape)].ravel(), minlength=counts.size)
        for one in (box.grown(WIDER), box)
    )
    part = 1 + int(np.argmax(about[1:])) if about[1:].any() else 0
    if not part or inside[part] >= LEAST_PART * counts[part]:
        return None
    whole = Box.around(parts == part)
    return None if whole is None else [round(side, 4) for side in astuple(whole)]


def _middle(labels: Labels, kind: str, box: Box) -> tuple[float, float]:
    """Return the middle row and column of a kind's pixels in a box."""
    inside = box.mask(*labels.shape) & (labels == LABELS.index(kind))
    rows, columns = np.nonzero(inside)
    return float(rows.mean()), float(columns.mean())
