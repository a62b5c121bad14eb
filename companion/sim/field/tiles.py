"""Paints the ground's materials as square tiles that repeat without a seam, and makes the noise for them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]
Colour = tuple[int, int, int]

SIZE = 512  # texels a side of a material's tile
TEXEL = 0.01  # m

# The ground's materials, in the order of `materials()`.
MEADOW_GRASS, FOREST_FLOOR, DRY_GRASS, DIRT, FOREST_DIRT, GRAVEL = range(6)


def noise(rng: np.random.Generator, rows: int, columns: int, shortest: float, longest: float) -> Floats:
    """Makes seamless noise (rows, columns) of mean 0 and deviation 1; wavelengths in texels."""
    spectrum = np.fft.rfft2(rng.standard_normal((rows, columns)))
    fy, fx = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None, :]
    frequency = np.hypot(fy, fx)
    frequency[0, 0] = 1.0
    band = (frequency >= 1 / longest) & (frequency <= 1 / shortest)
    field = np.fft.irfft2(spectrum * band / frequency, s=(rows, columns))
    return np.asarray(field / (field.std() + 1e-12), dtype=np.float32)


def as_bytes(field: Floats, spread: float = 40.0) -> Bytes:
    """Converts noise to bytes of mean 128 and deviation `spread`."""
    clipped: Bytes = np.clip(field * spread + 128, 0, 255).astype(np.uint8)
    return clipped


def blank(rows: int, columns: int) -> Bytes:
    """Makes an empty RGBA picture, all of it transparent."""
    return np.zeros((rows, columns, 4), np.uint8)


def materials(rng: np.random.Generator) -> list[Bytes]:
    """Paints one RGB tile (SIZE, SIZE, 3) for each material."""
    grass = _base(rng, (92, 112, 52), 0.16)
    _blades(rng, grass, 9000, [(78, 100, 42), (104, 128, 58), (124, 144, 72), (68, 90, 38), (142, 148, 86)])
    floor = _base(rng, (46, 50, 28), 0.2)
    _leaves(rng, floor, 1500, [(62, 66, 34), (78, 60, 36), (46, 62, 30), (92, 70, 42), (36, 44, 24)])
    _blades(rng, floor, 3500, [(48, 70, 32), (60, 84, 40), (38, 56, 26)])
    dry = _base(rng, (148, 136, 104), 0.14)
    _blades(rng, dry, 5200, [(166, 156, 104), (184, 172, 118), (136, 138, 82), (152, 134, 92)])
    dirt = _base(rng, (148, 118, 84), 0.12)
    _stones(rng, dirt, 900, [(164, 136, 102), (128, 100, 72), (176, 152, 122), (118, 92, 64)], 2)
    damp = _base(rng, (98, 74, 52), 0.16)
    _stones(rng, damp, 500, [(112, 88, 64), (82, 62, 44), (124, 102, 80)], 2)
    _leaves(rng, damp, 260, [(120, 84, 46), (98, 78, 40), (134, 98, 56), (76, 72, 36)])
    gravel = _base(rng, (158, 156, 152), 0.1)
    greys = [(172, 170, 167), (152, 150, 148), (184, 182, 179), (136, 134, 133), (168, 161, 152)]
    _stones(rng, gravel, 14000, greys, 1)
    _stones(rng, gravel, 900, greys, 2)
    return [grass, floor, dry, dirt, damp, gravel]


def _base(rng: np.random.Generator, colour: Colour, contrast: float) -> Bytes:
    field = 0.6 * noise(rng, SIZE, SIZE, 2, 12) + 0.7 * noise(rng, SIZE, SIZE, 12, 120)
    painted = np.asarray(colour) * (1 + contrast * field[..., None])
    return np.clip(painted, 0, 255).astype(np.uint8)


def _blades(rng: np.random.Generator, tile: Bytes, count: int, colours: Sequence[Colour]) -> None:
    import cv2

    for colour in colours:
        start = rng.uniform(0, SIZE, (count // len(colours), 2))
        angle = rng.uniform(0, 2 * np.pi, len(start))
        end = start + rng.uniform(4, 13, (len(start), 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        for shift in _shifts():
            strokes = np.stack([start, end], axis=1) + shift
            cv2.polylines(tile, list(strokes.astype(np.int32)), False, colour, 1)  # noqa: FBT003


def _leaves(rng: np.random.Generator, tile: Bytes, count: int, colours: Sequence[Colour]) -> None:
    import cv2

    for x, y, angle, pick, long in zip(
        *rng.uniform(0, SIZE, (2, count)),
        rng.uniform(0, 180, count),
        rng.integers(0, 99, count),
        rng.uniform(2.5, 5.5, count),
        strict=True,
    ):
        for shift in _shifts():
            centre = (int(x + shift[0]), int(y + shift[1]))
            cv2.ellipse(
                tile, centre, (int(long), int(long * 0.6)), angle, 0, 360, colours[pick % len(colours)], -1
            )


def _stones(
    rng: np.random.Generator, tile: Bytes, count: int, colours: Sequence[Colour], largest: int
) -> None:
    import cv2

    for x, y, pick, radius in zip(
        *rng.integers(0, SIZE, (2, count)),
        rng.integers(0, 99, count),
        rng.integers(1, largest + 1, count),
        strict=True,
    ):
        shade = tuple(int(c * 0.66) for c in colours[pick % len(colours)])
        for shift in _shifts() if min(x, y) < 4 or max(x, y) > SIZE - 5 else [(0, 0)]:
            centre = (int(x + shift[0]), int(y + shift[1]))
            cv2.circle(tile, (centre[0] + 1, centre[1] + 1), int(radius), shade, -1)
            cv2.circle(tile, centre, int(radius), colours[pick % len(colours)], -1)


def _shifts() -> list[tuple[int, int]]:
    """Returns the offsets at which each shape is drawn, so that one across a side continues opposite."""
    return [(dx, dy) for dx in (0, -SIZE, SIZE) for dy in (0, -SIZE, SIZE)]


class Mips:
    """Mipmaps of seamless tiles, which are read at points of the ground.

    `tiles`: (n, size, size, c) uint8 with c <= 4; size is a power of two. `texel`: a texel's width in metres.
    """

    def __init__(self, tiles: NDArray[np.uint8], texel: float) -> None:
        import cv2

        count, size = tiles.shape[:2]
        self.texel, self.top = texel, size.bit_length() - 1
        levels, starts, begin = [], [], 0
        for level in range(self.top + 1):
            side = size >> level
            small = np.zeros((count, side, side, 4), np.uint8)
            for tile, into in zip(tiles, small, strict=True):
                into[..., : tiles.shape[3]] = cv2.resize(
                    tile, (side, side), interpolation=cv2.INTER_AREA
                ).reshape(side, side, -1)
            levels.append(small.reshape(count, -1, 4))
            starts.append(begin)
            begin += side * side
        self._stride = begin  # texels from one tile to the next, all scales included
        self._flat = np.concatenate(levels, axis=1).reshape(-1, 4).view(np.uint32).ravel()
        self._starts = np.asarray(starts, np.int32)

    def level(self, footprint: Floats) -> tuple[NDArray[np.int32], ...]:
        """Makes what `read` needs for pixels that cover `footprint` metres of ground, once for a camera."""
        level = np.clip(np.log2(np.maximum(footprint / self.texel, 1e-6)), 0, self.top).astype(np.int32)
        bits = (self.top - level).astype(np.int32)
        return level, bits, ((1 << bits) - 1).astype(np.int32), self._starts[level]

    def read(
        self,
        x: Floats,
        y: Floats,
        level: tuple[NDArray[np.int32], ...],
        tile: NDArray[np.int32] | None = None,
    ) -> Bytes:
        """Reads four bytes at each point (m), (..., 4), from each point's own tile (None: from the first)."""
        down, bits, mask, start = level
        column = ((x * np.float32(1 / self.texel)).astype(np.int32) >> down) & mask
        row = ((y * np.float32(1 / self.texel)).astype(np.int32) >> down) & mask
        at = (row << bits) + column + start
        if tile is not None:
            at += tile * np.int32(self._stride)
        return np.take(self._flat, at).view(np.uint8).reshape(*x.shape, 4)
