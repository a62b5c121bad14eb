"""Draws what exchanged regions of interest led to: a plot, and a call of each of four views. RGB uint8."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from anytraverse.drawing import AMBER, FAINT, GREEN, INK, VERMILION, VIOLET, Colour, write
from anytraverse.frame import Image
from anytraverse.judged_picture import draw_frame, draw_state
from companion.desk.exchange.drive import CallView
from companion.desk.exchange.results import Pair

_COLOURS: tuple[Colour, ...] = (GREEN, AMBER, VIOLET)
_LEFT, _TOP, _ROW, _WIDTH, _RIGHT = 190, 46, 26, 460, 150
_VIEW = 480


def plot(pairs: Sequence[Pair]) -> Image:
    """Draw each call's distance as a dot, a row for each vehicle and region, and needless calls beside it.

    A line shows what the vehicle still needs to stop: dots on its left are too late.
    """
    vehicles = list(dict.fromkeys(pair.vehicle.name for pair in pairs))
    regions = list(dict.fromkeys(pair.region for pair in pairs))
    height = _TOP + _ROW * (len(pairs) + len(vehicles)) + 30
    canvas = np.full((height, _LEFT + _WIDTH + _RIGHT, 3), 255, np.uint8)
    most = math.ceil(
        max([one.vehicle.still_needs for one in pairs] + [c for one in pairs for c in one.calls])
    )
    foot = height - 30

    def x(metres: float) -> int:
        return _LEFT + round(_WIDTH * metres / most)

    write(canvas, "where the call opens, m before the front", (_LEFT, 18), 13, bold=True)
    write(canvas, "needless/100 m", (_LEFT + _WIDTH + 24, 18), 13, bold=True)
    for metres in range(most + 1):
        cv2.line(canvas, (x(metres), _TOP - 14), (x(metres), foot), (225, 225, 225), 1)
        write(canvas, str(metres), (x(metres) - 4, foot + 18), 12, FAINT)
    y = _TOP
    for vehicle in vehicles:
        rows = [one for one in pairs if one.vehicle.name == vehicle]
        needs = rows[0].vehicle.still_needs
        write(canvas, f"{vehicle}, {rows[0].vehicle.speed:.1f} m/s", (8, y), 13, bold=True)
        write(canvas, f"needs {needs:.1f} m", (x(needs) + 5, y), 12, VERMILION)
        cv2.line(canvas, (x(needs), y - 8), (x(needs), y + _ROW * len(rows) + 6), VERMILION, 2)
        for row in rows:
            y += _ROW
            colour = _COLOURS[regions.index(row.region) % len(_COLOURS)]
            write(canvas, f"region of {row.region}", (24, y + 4), 12)
            for call in row.calls:
                cv2.circle(canvas, (x(call), y), 5, colour, -1, cv2.LINE_AA)
                cv2.circle(canvas, (x(call), y), 5, INK, 1, cv2.LINE_AA)
            if row.never:
                write(canvas, f"{row.never} never", (_LEFT + 4, y + 4), 12, VERMILION)
            write(canvas, f"{row.needless:.1f}", (_LEFT + _WIDTH + 24, y + 4), 12)
        y += _ROW
    return canvas


def views(pairs: Sequence[Pair], kind: str = "drum") -> Image:
    """Draw a call of the first and the last vehicle, each with its own region and with the other's."""
    ends = (pairs[0].vehicle.name, pairs[-1].vehicle.name)
    chosen = [one for one in pairs if one.vehicle.name in ends and one.region in ends]
    drawn = [_view(one, one.tally.views.get(kind)) for one in chosen]
    return np.vstack([np.hstack(drawn[n : n + 2]) for n in range(0, len(drawn), 2)])


def _view(pair: Pair, view: CallView | None) -> Image:
    whose = "its own region" if pair.own else f"the region of {pair.region}"
    title = f"{pair.vehicle.name}, {whose}"
    if view is None:
        blank = np.full((_VIEW * 3 // 4, _VIEW, 3), 128, np.uint8)
        return draw_frame(blank, title, "no call opened", width=_VIEW)
    needs = pair.vehicle.still_needs
    late = view.distance < needs
    note = f"the call opens {view.distance:.1f} m ahead, {needs:.1f} m are needed: "
    region = view.settings.at(None).region
    return draw_state(
        view.seen.frame.image,
        view.seen,
        title,
        VERMILION if late else GREEN,
        region=region,
        note=note + ("too late" if late else "it stops"),
        width=_VIEW,
    )
