"""Painted drum, rock and log, as RGBA pictures with the ground at their lower edge."""

from __future__ import annotations

import numpy as np

from companion.field.tiles import Bytes, blank, noise

Picture = tuple[Bytes, float, float]  # RGBA; how much of the thing's diameter and of its height it spans
DRUM_COLOURS = ((176, 44, 36), (36, 78, 168), (222, 118, 28))  # red, blue, orange


def drum(rng: np.random.Generator, look: int) -> Picture:
    """Painted steel, lit from the upper left, with two rolling hoops, a lid, scratches and rust."""
    import cv2

    rows, columns, lid = 256, 160, 9
    picture = blank(rows, columns)
    body = np.asarray(DRUM_COLOURS[look], np.float32)
    across = np.linspace(-1, 1, columns)
    shade = (
        0.3
        + 0.6 * np.sqrt(np.clip(1 - (across + 0.3) ** 2 / 1.7, 0, 1))
        + 0.25 * np.exp(-(((across + 0.4) / 0.1) ** 2))
    )
    hoops = np.ones(rows)
    for y in (92, 168):
        hoops[y : y + 5], hoops[y + 5 : y + 10] = 1.2, 0.55
    rust = np.clip(noise(rng, rows, columns, 6, 60) - 1.3, 0, 1)[..., None] * 0.9
    rust += np.clip(np.linspace(-2.2, 0.5, rows), 0, 1)[:, None, None]
    skin = body * (1 - np.clip(rust, 0, 0.8)) + np.array([104, 66, 42]) * np.clip(rust, 0, 0.8)
    skin = (
        skin
        * (shade[None, :, None] * hoops[:, None, None])
        * (1 + 0.04 * noise(rng, rows, columns, 2, 20)[..., None])
    )
    mask = np.zeros((rows, columns), np.uint8)
    cv2.rectangle(mask, (2, lid), (columns - 3, rows - lid - 1), 255, -1)
    cv2.ellipse(mask, (columns // 2, rows - lid - 2), (columns // 2 - 3, lid), 0, 0, 360, 255, -1)
    cv2.ellipse(mask, (columns // 2, lid), (columns // 2 - 3, lid), 0, 0, 360, 255, -1)
    picture[..., :3], picture[..., 3] = np.clip(skin, 0, 255).astype(np.uint8), mask
    rim = tuple(int(min(255, c * 1.2)) for c in body)
    cv2.ellipse(
        picture,
        (columns // 2, lid),
        (columns // 2 - 3, lid),
        0,
        0,
        360,
        (*(int(c * 0.8) for c in body), 255),
        -1,
    )
    cv2.ellipse(picture, (columns // 2, lid), (columns // 2 - 3, lid), 0, 0, 360, (*rim, 255), 2)
    return picture, 1.0, 1.04


def rock(rng: np.random.Generator, look: int) -> Picture:
    """A light boulder in grey-blue, cut into facets."""
    import cv2

    rows, columns = 168, 240
    picture = blank(rows, columns)
    angles = np.linspace(np.pi, 2 * np.pi, 9)
    jag = rng.uniform(0.82, 1.0, 9)
    rim = np.stack([120 + 114 * jag * np.cos(angles), 150 + 146 * jag * np.sin(angles)], axis=1)
    rim = np.vstack([rim, [[226, 160], [120, 167], [14, 160]]])
    peak = np.array([120 + rng.uniform(-30, 30), 78 + rng.uniform(-14, 14)])
    for i in range(len(rim)):
        facet = np.array([rim[i], rim[(i + 1) % len(rim)], peak])
        middle = facet.mean(axis=0)
        light = (
            0.98 - 0.18 * (middle[0] - 120) / 114 - 0.34 * (middle[1] - 80) / 80 + rng.uniform(-0.06, 0.06)
        )
        base = np.array([(168, 182, 204), (158, 172, 198)][look])
        cv2.fillPoly(
            picture, [facet.astype(np.int32)], (*(int(c) for c in np.clip(base * light, 0, 255)), 255)
        )
    rough = 0.07 * noise(rng, rows, columns, 2, 10) + 0.06 * noise(rng, rows, columns, 10, 60)
    picture[..., :3] = np.clip(
        cv2.GaussianBlur(picture[..., :3], (0, 0), 2.0) * (1 + rough[..., None]), 0, 255
    ).astype(np.uint8)
    shown = np.flatnonzero(picture[..., 3].any(axis=0))
    return picture[:, shown[0] : shown[-1] + 1], 1.0, 1.0


def log(rng: np.random.Generator, look: int) -> Picture:
    """A Scots pine trunk on its side, red of bark, with the cut face and its rings at one end."""
    import cv2

    rows, columns = 84, 512
    picture = blank(rows, columns)
    down = np.linspace(-1, 1, rows)
    shade = 0.4 + 0.75 * np.sqrt(np.clip(1 - (down + 0.35) ** 2 / 2.0, 0, 1))
    grain = 0.16 * cv2.resize(noise(rng, rows, 64, 2, 12), (columns, rows)) + 0.1 * noise(
        rng, rows, columns, 3, 30
    )
    bark = np.array([114, 56, 42]) * shade[:, None, None] * (1 + grain[..., None])
    mask = np.zeros((rows, columns), np.uint8)
    cv2.rectangle(mask, (22, 2), (columns - 24, rows - 3), 255, -1)
    for end in (22, columns - 24):
        cv2.ellipse(mask, (end, rows // 2), (20, rows // 2 - 2), 0, 0, 360, 255, -1)
    picture[..., :3], picture[..., 3] = np.clip(bark, 0, 255).astype(np.uint8), mask
    cut = 22 if look else columns - 24
    for i, part in enumerate(np.linspace(1, 0.12, 7)):
        colour = (214, 150, 92) if i % 2 else (186, 112, 66)
        cv2.ellipse(
            picture,
            (cut, rows // 2),
            (int(20 * part), int((rows // 2 - 2) * part)),
            0,
            0,
            360,
            (*colour, 255),
            -1,
        )
    return picture, 1.0, 1.0
