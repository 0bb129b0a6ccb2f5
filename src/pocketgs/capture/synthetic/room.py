"""The demo scene: a laid table in the corner of a room. Metres, z is up, the table is centred on the origin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.synthetic import materials
from pocketgs.capture.synthetic.scene import Finish, Part, assemble, ball, bar, box, upright
from pocketgs.capture.synthetic.tracing import Scene

TABLE = 0.72
"""Height of the table top."""

WALL = 1.75
"""Distance of either wall from the table's middle."""

CREAM, WHITE, CHARCOAL = (0.93, 0.88, 0.78), (0.95, 0.94, 0.91), (0.14, 0.14, 0.16)
NAVY, TEAL, RED, MUSTARD, SAGE = (
    (0.15, 0.22, 0.4),
    (0.2, 0.5, 0.52),
    (0.76, 0.24, 0.2),
    (0.88, 0.67, 0.26),
    (0.56, 0.67, 0.54),
)
OAK = Finish((0.86, 0.67, 0.44), (0.5, 0.32, 0.19), materials.WOOD)
WALNUT = Finish((0.56, 0.37, 0.23), (0.3, 0.18, 0.11), materials.WOOD)
STEEL = Finish((0.62, 0.64, 0.67))
BLACK_METAL = Finish((0.2, 0.2, 0.22))


def room() -> Scene:
    """The demo scene for the ray caster."""
    return furnished()


def furnished(more: Sequence[Part] = ()) -> Scene:
    """The demo scene with additional parts."""
    furniture = [_rug(), _table(), _tray(), _books(), _toys(), _rack(), _chair(), _lamp(), _sideboard()]
    return assemble(_shell(), [part for group in [*furniture, more] for part in group])


def _shell() -> list[Part]:
    """Floor and two walls, long enough to fill every view."""
    floor = Finish((0.8, 0.6, 0.4), (0.45, 0.29, 0.17), materials.PLANKS)
    paper = Finish((0.3, 0.48, 0.53), (0.17, 0.31, 0.37), materials.WALLPAPER)
    bricks = Finish(CREAM, texture=materials.BRICKS)
    return [
        box((2.5, -2.5, -0.05), (6.5, 6.5, 0.05), floor),
        box((2.5, WALL + 0.05, 1.6), (6.5, 0.05, 1.6), bricks),
        box((-WALL - 0.05, -2.5, 1.6), (0.05, 6.5, 1.6), paper),
    ]


def _rug() -> list[Part]:
    weave = Finish((0.72, 0.64, 0.52), (0.24, 0.27, 0.36), materials.WEAVE)
    border = Finish((0.5, 0.22, 0.2), (0.76, 0.66, 0.52), materials.LETTERING)
    return [box((0, 0, 0.004), (0.98, 0.78, 0.004), border, 20), box((0, 0, 0.006), (0.9, 0.7, 0.006), weave, 20)]


def _table() -> list[Part]:
    top = Part(2, (0, 0, TABLE - 0.015), (0.62, 0.62, 0.015), OAK, np.eye(3), dimming=0.42)
    angles = np.radians([25, 115, 205, 295])
    feet = [(0.44 * float(np.cos(angle)), 0.44 * float(np.sin(angle)), 0.0) for angle in angles]
    return [top, *(upright(foot, 0.024, TABLE - 0.03, WALNUT) for foot in feet)]


def _tray() -> list[Part]:
    """A lacquered tray that reflects the glossy ball and the mug on it."""
    lacquer = Finish((0.1, 0.13, 0.16), gloss=0.22)
    glaze = Finish(WHITE, TEAL, materials.STRIPES)
    return [
        upright((-0.13, -0.3, TABLE), 0.2, 0.012, lacquer),
        ball((-0.2, -0.27, TABLE + 0.012 + 0.085), 0.085, Finish((0.62, 0.06, 0.07), gloss=0.12)),
        upright((-0.04, -0.35, TABLE + 0.012), 0.045, 0.11, glaze, dimming=0.045),
    ]


def _books() -> list[Part]:
    """A stack of three books with a plain box on top."""
    paper = Finish((0.95, 0.92, 0.84), (0.7, 0.66, 0.58), materials.PAGES)
    covers = [(NAVY, MUSTARD, 12.0), (RED, CREAM, 31.0), (CREAM, NAVY, 20.0)]
    parts, height = [], TABLE
    for (cloth, print_, turn), half in zip(covers, [(0.16, 0.12), (0.145, 0.105), (0.13, 0.095)], strict=True):
        cover = Finish(cloth, print_, materials.LETTERING)
        parts.append(box((0.3, 0.2, height + 0.02), (half[0] - 0.006, half[1] - 0.006, 0.017), paper, turn))
        parts.append(box((0.3, 0.2, height + 0.0015), (*half, 0.0015), cover, turn))
        parts.append(box((0.3, 0.2, height + 0.0385), (*half, 0.0015), cover, turn, dimming=0.1))
        height += 0.04
    return [*parts, box((0.29, 0.21, height + 0.05), (0.06, 0.06, 0.05), Finish(SAGE), 48, dimming=0.06)]


def _toys() -> list[Part]:
    stripes = Finish(MUSTARD, RED, materials.STRIPES)
    stone = Finish(WHITE, texture=materials.TERRAZZO)
    beach, stickers = Finish(WHITE, texture=materials.BEACH_BALL), Finish(WHITE, CHARCOAL, materials.STICKERS)
    return [
        upright((0.3, -0.22, TABLE), 0.085, 0.26, stripes, taper=0.12, dimming=0.07),
        upright((-0.22, 0.33, TABLE), 0.06, 0.27, stone, taper=1.55, dimming=0.09),
        ball((0.03, -0.02, TABLE + 0.1), 0.1, Finish(CREAM, texture=materials.TERRAZZO), 30),
        box((0.47, -0.02, TABLE + 0.06), (0.06, 0.06, 0.06), stickers, 33, dimming=0.06),
        ball((0.75, 0.85, 0.19), 0.19, beach, 20),
        box((-0.75, -0.75, 0.12), (0.12, 0.12, 0.12), stickers, 15, dimming=0.12),
    ]


def _rack() -> list[Part]:
    """A plate rack of thin bars: two rails on feet, with upright wires between them."""
    x, near, far = -0.42, -0.12, 0.2
    low, high = TABLE + 0.03, TABLE + 0.24
    rails = [bar((x, near, height), (x, far, height), 0.006, STEEL) for height in (low, high)]
    wires = [bar((x, y, low), (x, y, high), 0.005, STEEL) for y in np.linspace(near + 0.02, far - 0.02, 7)]
    feet = [bar((x - 0.06, y, TABLE + 0.006), (x + 0.06, y, TABLE + 0.006), 0.006, STEEL) for y in (near, far)]
    posts = [bar((x, y, TABLE), (x, y, high + 0.03), 0.0065, STEEL) for y in (near, far)]
    return [*rails, *wires, *feet, *posts]


def _chair() -> list[Part]:
    """A wire chair at the papered wall, facing the table."""
    centre, metal, radius = (-1.08, 0.05), Finish((0.78, 0.3, 0.16)), 0.0075
    left, right, front, back = centre[1] + 0.2, centre[1] - 0.2, centre[0] + 0.2, centre[0] - 0.2
    seat = box((centre[0], centre[1], 0.44), (0.21, 0.21, 0.014), Finish(CREAM, TEAL, materials.WEAVE), dimming=0.16)
    legs = [bar((front, y, 0.0), (front, y, 0.43), radius, metal) for y in (left, right)]
    posts = [bar((back, y, 0.0), (back - 0.06, y, 0.95), radius, metal) for y in (left, right)]
    slats = [
        bar((back - 0.06 * height / 0.95, left, height), (back - 0.06 * height / 0.95, right, height), radius, metal)
        for height in (0.2, 0.6, 0.7, 0.8, 0.9)
    ]
    return [seat, *legs, *posts, *slats]


def _lamp() -> list[Part]:
    """A standing lamp in the corner, its stand 1.3 cm thick."""
    x, y = -1.2, 1.15
    shade = Finish(CREAM, MUSTARD, materials.STRIPES)
    return [
        upright((x, y, 0), 0.15, 0.02, BLACK_METAL),
        upright((x, y, 0.02), 0.0065, 1.3, BLACK_METAL),
        upright((x, y, 1.25), 0.21, 0.26, shade, taper=0.62, dimming=0.15),
    ]


def _sideboard() -> list[Part]:
    """A plain cupboard with a framed print above it, and another print on the papered wall."""
    art = Finish(WHITE, TEAL, materials.WEAVE)
    letters = Finish(WHITE, RED, materials.LETTERING)
    return [
        box((0.55, WALL - 0.19, 0.3), (0.48, 0.19, 0.3), Finish((0.82, 0.78, 0.7)), dimming=0.3),
        box((0.6, WALL - 0.012, 1.2), (0.4, 0.012, 0.29), Finish(CHARCOAL)),
        box((0.6, WALL - 0.014, 1.2), (0.37, 0.014, 0.26), art),
        box((-WALL + 0.012, -0.75, 1.2), (0.012, 0.3, 0.38), Finish(WHITE)),
        box((-WALL + 0.014, -0.75, 1.2), (0.014, 0.26, 0.34), letters),
    ]
