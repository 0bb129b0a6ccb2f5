"""Procedural textures of the demo scene: colour as a function of position, so that every view agrees on it.

A material takes (3, N) float32 points (x, y, z in rows) in metres, relative to the origin of the surface they lie on,
and gives (3, N) float32 RGB in [0, 1], display-referred. The finest detail, about 5 mm, is a pixel of the demo.
"""

from __future__ import annotations

import numpy as np

Colour = tuple[float, float, float]

_LATTICE = np.random.default_rng(2024).random(4096, dtype=np.float32)
_LATTICE_STRIDES = (73856093, 19349663, 83492791, 50331653)


def _palette(*colours: tuple[int, int, int]) -> np.ndarray:
    return np.array(colours, dtype=np.float32).T / 255


BRICKS = _palette((168, 84, 62), (190, 104, 74), (148, 66, 54), (202, 128, 96), (176, 96, 84))
DOTS = _palette((236, 186, 72), (222, 96, 80), (240, 232, 214), (92, 164, 168), (236, 144, 92))
TOYS = _palette((208, 52, 48), (36, 110, 190), (244, 200, 52), (46, 150, 84), (236, 236, 232), (232, 124, 40))


def oak_floor(points: np.ndarray) -> np.ndarray:
    """Planks 12 cm wide and 90 cm long that run along y, with grain and dark joints, on a surface of constant z."""
    x, y, _ = points
    across = x / 0.12
    plank = np.floor(across)
    along = y / 0.9 + random_at(plank)
    tone = random_at(plank, np.floor(along))
    grain = value_noise(np.stack([x * 90, y * 9, tone * 50]))
    rings = _wave(x * 160 + 9 * value_noise(points * 7))
    wood = _blend((0.42, 0.26, 0.15), (0.86, 0.66, 0.42), 0.45 * tone + 0.3 * grain + 0.25 * rings)
    joint = (_to_border(across) < 0.02) | (_to_border(along) < 0.004)
    return np.where(joint, 0.16, wood)


def brick_wall(points: np.ndarray) -> np.ndarray:
    """Bricks of 24 x 9 cm in pale mortar, on a surface of constant y."""
    x, _, z = points
    row = z / 0.09
    along = x / 0.24 + 0.5 * (np.floor(row) % 2)
    shade = 0.5 * value_noise(points * 45) + 0.5 * value_noise(points * 110)
    brick = _pick(BRICKS, np.floor(along), np.floor(row)) * (0.7 + 0.5 * shade)
    mortar = (_to_border(row) < 0.07) | (_to_border(along) < 0.026)
    return np.where(mortar, _blend((0.62, 0.6, 0.56), (0.84, 0.82, 0.78), shade), brick)


def dotted_wallpaper(points: np.ndarray) -> np.ndarray:
    """Fine diagonal stripes under ringed dots of many colours, on a surface of constant x."""
    _, y, z = points
    paper_weight = 0.6 * _wave((y + z) * 150) + 0.4 * value_noise(points * 14)
    paper = _blend((0.16, 0.3, 0.38), (0.26, 0.44, 0.5), paper_weight)
    column, row = np.floor(y / 0.17), np.floor(z / 0.17)
    radius = np.hypot(y / 0.17 - column - 0.5, z / 0.17 - row - 0.5)
    dotted = (radius < 0.2) | ((radius > 0.26) & (radius < 0.33))
    return np.where(dotted, _pick(DOTS, column, row), paper)


def turned_wood(points: np.ndarray) -> np.ndarray:
    """Growth rings about a tilted axis."""
    x, y, z = points
    radius = np.hypot(x + 0.3 * z + 0.06, y + 0.1) + 0.05 * value_noise(points * 9)
    fibre = value_noise(np.stack([x * 120, y * 120, z * 25]))
    return _blend((0.36, 0.19, 0.09), (0.9, 0.66, 0.38), 0.75 * _wave(radius * 190) + 0.25 * fibre)


def beach_ball(points: np.ndarray) -> np.ndarray:
    """Ten coloured segments with white piping between them, a hoop of small squares and white caps."""
    latitude, longitude = _latitude_longitude(points)
    turn = longitude / (2 * np.pi)
    ball = TOYS[:, (np.floor(turn * 10) % 5).astype(np.int64)] * (0.85 + 0.15 * _wave(latitude * 60))
    squares = (np.floor(turn * 40) + np.floor(latitude * 14)) % 2
    ball = np.where(np.abs(latitude) < 0.143, _blend((0.1, 0.12, 0.2), (0.95, 0.92, 0.86), squares), ball)
    white = (_to_border(turn * 10) < 0.04) | (np.abs(latitude) > 1.2)
    return np.where(white, 0.94, ball)


def marble(points: np.ndarray) -> np.ndarray:
    """Pale stone with blue veins."""
    x, _, z = points
    folds = value_noise(points * 12) + 0.5 * value_noise(points * 28)
    vein = np.abs(np.sin(x * 14 + z * 9 + 6 * folds))
    return _blend((0.1, 0.16, 0.34), (0.93, 0.93, 0.9), np.sqrt(vein) * (0.8 + 0.2 * value_noise(points * 90)))


def chequered_ball(points: np.ndarray) -> np.ndarray:
    """Mottled chequer of latitude and longitude in two greens."""
    latitude, longitude = _latitude_longitude(points)
    chequer = (np.floor(latitude * (9 / np.pi)) + np.floor(longitude * (9 / np.pi))) % 2
    return _blend((0.07, 0.3, 0.2), (0.8, 0.9, 0.55), 0.75 * chequer + 0.25 * value_noise(points * 60))


def puzzle_cube(points: np.ndarray) -> np.ndarray:
    """Three by three stickers of random colour on every face of a cube centred on the origin."""
    face = np.argmax(np.abs(points), axis=0)
    # Pulled in a little: on the very face its coordinate would fall on either side of a cell's border.
    cells = (points / np.abs(points).max(axis=0) * 0.999 + 1) * 1.5
    border = _to_border(cells)
    border[face, np.arange(points.shape[1])] = 0.5
    return np.where(border.min(axis=0) < 0.07, 0.07, _pick(TOYS, *np.floor(cells), face))


def value_noise(points: np.ndarray) -> np.ndarray:
    """(N,) smooth noise in [0, 1] at (3, N) points: random values at integer coordinates, interpolated."""
    cell = np.floor(points)
    fraction = points - cell
    weight = fraction * fraction * (3 - 2 * fraction)
    weights = (1 - weight, weight)
    x, y, z = cell.astype(np.int64)
    total = np.zeros_like(weight[0])
    for i, j, k in np.ndindex(2, 2, 2):
        total += weights[i][0] * weights[j][1] * weights[k][2] * random_at(x + i, y + j, z + k)
    return total


def random_at(*cell: np.ndarray) -> np.ndarray:
    """(N,) random numbers in [0, 1), always the same for the same integer cell of up to four coordinates."""
    mixed = np.zeros(len(cell[0]), dtype=np.int64)
    for coordinate, stride in zip(cell, _LATTICE_STRIDES[: len(cell)], strict=True):
        mixed ^= coordinate.astype(np.int64) * stride
    return _LATTICE[(mixed ^ (mixed >> 12)) & 4095]


def _pick(palette: np.ndarray, *cell: np.ndarray) -> np.ndarray:
    """(3, N) a random colour of the palette for each cell."""
    return palette[:, (random_at(*cell) * palette.shape[1]).astype(np.int64)]


def _latitude_longitude(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = points
    return np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)


def _wave(phase: np.ndarray) -> np.ndarray:
    return 0.5 + 0.5 * np.sin(phase)


def _to_border(cells: np.ndarray) -> np.ndarray:
    """Distance to the nearest integer."""
    return np.abs(cells - np.round(cells))


def _blend(low: Colour, high: Colour, weight: np.ndarray) -> np.ndarray:
    start, end = np.array([low, high], dtype=np.float32)[:, :, None]
    return start + (end - start) * weight
