"""Procedural textures of the demo scene.

A texture is a function of the position on a surface in metres: (u, v) along it and (x, y, z) in the object's own axes.
`pixel` is the length that a pixel covers there; the finest detail is about two pixels at the demo's default size.
Colours are RGB in [0, 1], display-referred. Every part of the scene has two colours of its own, `light` and `dark`.
"""

from __future__ import annotations

import math

import numpy as np

from pocketgs.capture.synthetic.noise import noise, random_at
from pocketgs.system.compile import part

Colour = tuple[float, float, float]

PLAIN, WOOD, PLANKS, BRICKS, WALLPAPER, WEAVE, TERRAZZO, STRIPES, BEACH_BALL, LETTERING, PAGES, STICKERS = range(12)

CHEERFUL = np.array(
    [(214, 66, 52), (38, 112, 178), (244, 196, 60), (58, 148, 98), (240, 234, 220), (232, 126, 48), (112, 74, 140)]
)
CLAY = np.array([(168, 84, 62), (186, 104, 76), (150, 70, 58), (198, 126, 96), (176, 98, 84)])
PETALS = np.array([(236, 190, 92), (226, 110, 88), (244, 236, 218), (140, 190, 176), (238, 154, 110)])


@part
def colour_at(
    material: int, x: float, y: float, z: float, u: float, v: float, pixel: float, light: Colour, dark: Colour
) -> Colour:
    """Evaluate the texture with number `material` at a point; see the module's docstring."""
    if material == WOOD:
        return _wood(x, y, z, pixel, light, dark)
    if material == PLANKS:
        return _planks(u, v, pixel, light, dark)
    if material == BRICKS:
        return _bricks(u, v, pixel)
    if material == WALLPAPER:
        return _wallpaper(u, v, pixel, light, dark)
    if material == WEAVE:
        return _weave(u, v, light, dark)
    if material == TERRAZZO:
        return _terrazzo(x, y, z, light)
    if material == STRIPES:
        return _stripes(x, y, z, pixel, light, dark)
    if material == BEACH_BALL:
        return _beach_ball(x, y, z, pixel)
    if material == LETTERING:
        return _lettering(u, v, light, dark)
    if material == PAGES:
        return _blend(dark, light, noise(u * 12, z * 160, v * 3, pixel * 160))
    if material == STICKERS:
        return _stickers(x, y, z, u, v, dark)
    return light


@part
def _wood(x: float, y: float, z: float, pixel: float, light: Colour, dark: Colour) -> Colour:
    """Growth rings and fibres that run along x."""
    rings = _wave(y * 190 + z * 60 + 14 * noise(x * 2.5, y * 9, z * 9, pixel * 9))
    fibre = noise(x * 30, y * 95, z * 95, pixel * 95)
    return _blend(dark, light, 0.4 * rings + 0.6 * fibre)


@part
def _planks(u: float, v: float, pixel: float, light: Colour, dark: Colour) -> Colour:
    """Planks 13 cm wide and 90 cm long that run along v, with grain, knots and dark joints."""
    across = u / 0.13
    row = math.floor(across)
    along = v / 0.9 + random_at(row, 0, 1)
    tone = random_at(row, math.floor(along), 2)
    if _to_border(across) < 0.025 or _to_border(along) < 0.004:
        return _scaled(dark, 0.45)
    grain = noise(u * 75, v * 13, tone * 50, pixel * 75)
    rings = _wave(u * 150 + 16 * noise(u * 9, v * 4, tone * 20, pixel * 9))
    weight = 0.35 * tone + 0.4 * grain + 0.25 * rings
    knot = _speckle(u / 0.065, v / 0.09, 3)
    return _blend(dark, light, weight) if knot > 0.5 else _scaled(_blend(dark, light, weight), 0.55 + 0.9 * knot)


@part
def _bricks(u: float, v: float, pixel: float) -> Colour:
    """Mottled bricks of 24 x 9 cm in pale mortar."""
    row = math.floor(v / 0.09)
    along = u / 0.24 + 0.5 * (row % 2)
    shade = 0.5 * noise(u * 28, v * 28, 0, pixel * 28) + 0.5 * noise(u * 65, v * 65, 5, pixel * 65)
    if _to_border(v / 0.09) < 0.085 or _to_border(along) < 0.032:
        return _scaled((0.86, 0.83, 0.78), 0.8 + 0.25 * shade)
    brick = _pick(CLAY, random_at(math.floor(along), row, 4))
    return _scaled(brick, 0.55 + 0.85 * shade)


@part
def _wallpaper(u: float, v: float, pixel: float, light: Colour, dark: Colour) -> Colour:
    """Flowers and berries on striped paper, each rotated and coloured at random."""
    column, row = math.floor(u / 0.15), math.floor(v / 0.15)
    east, north = u / 0.15 - column - 0.5, v / 0.15 - row - 0.5
    chance = random_at(column, row, 5)
    radius, turn = math.hypot(east, north), math.atan2(north, east)
    if radius < 0.08:
        return _pick(CHEERFUL, random_at(column, row, 6))
    if radius < 0.24 + 0.09 * math.cos((4 + math.floor(3 * chance)) * turn + 6 * chance):
        return _scaled(_pick(PETALS, chance), 0.85 + 0.6 * radius)
    if _speckle(u / 0.05, v / 0.05, 7) < 0.22:
        return _pick(PETALS, random_at(math.floor(u / 0.05), math.floor(v / 0.05), 8))
    return _blend(dark, light, 0.5 * _wave((u + v) * 105) + 0.5 * noise(u * 50, v * 50, 0, pixel * 50))


@part
def _weave(u: float, v: float, light: Colour, dark: Colour) -> Colour:
    """Truchet tiles (Smith, 1987): arcs that meet across cell borders, on a multicoloured ground."""
    column, row = math.floor(u / 0.085), math.floor(v / 0.085)
    east, north = u / 0.085 - column, v / 0.085 - row
    chance = random_at(column, row, 9)
    if chance < 0.5:
        east = 1 - east
    near = math.hypot(east, north)
    far = math.hypot(1 - east, 1 - north)
    if abs(near - 0.5) < 0.12 or abs(far - 0.5) < 0.12:
        return light
    if near < 0.2 or far < 0.2:
        return _blend(_pick(PETALS, random_at(column, row, 10)), dark, 0.25)
    return dark if near < 0.5 or far < 0.5 else _blend(_pick(CLAY, random_at(column, row, 11)), dark, 0.35)


@part
def _terrazzo(x: float, y: float, z: float, light: Colour) -> Colour:
    """Chips of coloured stone, 1 to 2 cm, throughout a pale body."""
    i, j, k = math.floor(x / 0.026), math.floor(y / 0.026), math.floor(z / 0.026)
    chance = random_at(i, j, k)
    east, north, up = x / 0.026 - i - 0.5, y / 0.026 - j - 0.5, z / 0.026 - k - 0.5
    # Chips are flattened, each in its own direction, and fill their cells to different degrees.
    slant = east * (chance - 0.5) + north * (random_at(i, j, k + 71) - 0.5)
    if east * east + north * north + up * up + 2 * slant < 0.05 + 0.17 * chance:
        return _pick(CHEERFUL, random_at(i, j, k + 37))
    return light


@part
def _stripes(x: float, y: float, z: float, pixel: float, light: Colour, dark: Colour) -> Colour:
    """Rings around z with a zigzag, mottled like glaze."""
    turn = math.atan2(y, x) / (2 * math.pi)
    zigzag = abs(_fraction(turn * 12) - 0.5)
    band = z / 0.045 + 0.7 * zigzag
    glaze = 0.8 + 0.4 * noise(x * 70, y * 70, z * 70, pixel * 70)
    if _fraction(band) < 0.22:
        return _pick(CHEERFUL, random_at(math.floor(band), math.floor(turn * 12), 12))
    return _scaled(light if math.floor(band) % 2 == 0 else dark, glaze)


@part
def _beach_ball(x: float, y: float, z: float, pixel: float) -> Colour:
    """Ten coloured segments with white piping, a chequered hoop and white caps."""
    latitude, turn = math.atan2(z, math.hypot(x, y)), math.atan2(y, x) / (2 * math.pi) + 1
    if abs(latitude) > 1.2 or _to_border(turn * 10) < 0.04:
        return (0.94, 0.93, 0.9)
    if abs(latitude) < 0.16:
        chequer = (math.floor(turn * 32) + math.floor(latitude / 0.16)) % 2
        return (0.95, 0.92, 0.86) if chequer == 1 else (0.12, 0.13, 0.2)
    mottle = 0.85 + 0.3 * noise(x * 40, y * 40, z * 40, pixel * 40)
    return _scaled(_pick(CHEERFUL, _fraction(math.floor(turn * 10) * 2 / 7 + 0.01)), mottle)


@part
def _lettering(u: float, v: float, light: Colour, dark: Colour) -> Colour:
    """Lines that resemble print."""
    line = math.floor(v / 0.022)
    letter = math.floor(u / 0.009)
    word = random_at(math.floor(u / 0.045), line, 13) < 0.8
    inked = word and _fraction(v / 0.022) < 0.58 and random_at(letter, math.floor(v / 0.011), 14 + line) < 0.62
    return dark if inked else light


@part
def _stickers(x: float, y: float, z: float, u: float, v: float, dark: Colour) -> Colour:
    """Squares of 6 cm in random colours, each with a smaller one inside, separated by dark gaps."""
    gap = min(_to_border(u / 0.06), _to_border(v / 0.06))
    if gap < 0.08:
        return dark
    # Moved in a little: exactly on the face, coordinates would fall on either side of a cell's border.
    i, j, k = math.floor(x / 0.0606), math.floor(y / 0.0606), math.floor(z / 0.0606)
    return _pick(CHEERFUL, random_at(i, j, k + (15 if gap > 0.28 else 30)))


@part
def _speckle(u: float, v: float, layer: int) -> float:
    """Distance from the cell's random point near its middle; 1 if the cell has none."""
    column, row = math.floor(u), math.floor(v)
    if random_at(column, row, 20 + layer) < 0.55:
        return 1.0
    east = u - column - 0.3 - 0.4 * random_at(column, row, 40 + layer)
    north = v - row - 0.3 - 0.4 * random_at(column, row, 60 + layer)
    return 2 * math.hypot(east, north)


@part
def _pick(palette: np.ndarray, chance: float) -> Colour:
    """Choose a palette colour by a number in [0, 1)."""
    colour = palette[int(chance * len(palette))]
    return (colour[0] / 255, colour[1] / 255, colour[2] / 255)


@part
def _blend(low: Colour, high: Colour, weight: float) -> Colour:
    return (
        low[0] + (high[0] - low[0]) * weight,
        low[1] + (high[1] - low[1]) * weight,
        low[2] + (high[2] - low[2]) * weight,
    )


@part
def _scaled(colour: Colour, factor: float) -> Colour:
    return (colour[0] * factor, colour[1] * factor, colour[2] * factor)


@part
def _wave(phase: float) -> float:
    return 0.5 + 0.5 * math.sin(phase)


@part
def _fraction(value: float) -> float:
    return value - math.floor(value)


@part
def _to_border(cells: float) -> float:
    """Distance to the nearest integer."""
    return abs(cells - math.floor(cells + 0.5))
