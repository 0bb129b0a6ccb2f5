"""Scenes made of parts, and their arrays for the ray caster."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.synthetic.materials import PLAIN
from pocketgs.capture.synthetic.shapes import BALL, BOX, FRUSTUM
from pocketgs.capture.synthetic.tracing import SUN_ACROSS, SUN_CELL, SUN_CELLS, SUN_REACH, SUN_SPREAD, SUN_UP, Scene

Triple = tuple[float, float, float]

MAX_SHADOW = 1.8
"""Maximum length of a shadow in metres."""


@dataclass(frozen=True)
class Finish:
    """The appearance of a surface.

    Attributes:
        light, dark: the texture's own two colours, display-referred RGB in [0, 1].
        texture: of `materials.py`.
        gloss: fraction of the light that is reflected head-on; 0 is matt.
    """

    light: Triple
    dark: Triple = (0.12, 0.12, 0.14)
    texture: int = PLAIN
    gloss: float = 0.0


@dataclass(frozen=True)
class Part:
    """A unit shape of `shapes.py`, scaled by `half_size` metres along its own axes, the columns of `axes`.

    `dimming` is the radius in metres of the ball that represents the part in ambient occlusion.
    """

    shape: int
    centre: Triple
    half_size: Triple
    finish: Finish
    axes: np.ndarray
    taper: float = 1.0
    dimming: float = 0.0


def box(centre: Triple, half_size: Triple, finish: Finish, turn: float = 0.0, dimming: float = 0.0) -> Part:
    """A box rotated by `turn` degrees about z."""
    return Part(BOX, centre, half_size, finish, _turned(turn), dimming=dimming)


def ball(centre: Triple, radius: float, finish: Finish, turn: float = 0.0) -> Part:
    """A ball rotated by `turn` degrees about z."""
    return Part(BALL, centre, (radius, radius, radius), finish, _turned(turn), dimming=radius)


def upright(
    base: Triple, radius: float, height: float, finish: Finish, taper: float = 1.0, dimming: float = 0.0
) -> Part:
    """A cylinder or, with `taper`, a frustum that stands on the point `base`."""
    centre = (base[0], base[1], base[2] + height / 2)
    return Part(FRUSTUM, centre, (radius, radius, height / 2), finish, np.eye(3), taper, dimming)


def bar(start: Triple, end: Triple, radius: float, finish: Finish) -> Part:
    """A round bar between two points."""
    middle, half = (np.add(start, end)) / 2, np.subtract(end, start) / 2
    length = float(np.linalg.norm(half))
    forward = half / length
    side = np.cross(forward, np.eye(3)[np.argmin(np.abs(forward))])
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(forward, side), forward], axis=1)
    return Part(FRUSTUM, (middle[0], middle[1], middle[2]), (radius, radius, length), finish, axes)


def assemble(room: Sequence[Part], furniture: Sequence[Part]) -> Scene:
    """The arrays of a scene. Parts of the room itself cast no shadow."""
    parts = [*room, *furniture]
    casts, cast_ends = _sun_grid(furniture, len(room))
    return Scene(
        shapes=np.array([part.shape for part in parts]),
        tapers=np.array([part.taper for part in parts]),
        world_to_unit=np.array([_world_to_unit(part) for part in parts]),
        half_sizes=np.array([part.half_size for part in parts]),
        materials=np.array([part.finish.texture for part in parts]),
        paints=np.array([(part.finish.light, part.finish.dark) for part in parts]),
        gloss=np.array([part.finish.gloss for part in parts]),
        bounds=np.array([(*part.centre, _reach(part)) for part in parts]),
        dimming=np.array([(*part.centre, part.dimming) for part in parts if part.dimming > 0]),
        everything=np.arange(len(parts)),
        casts=casts,
        cast_ends=cast_ends,
    )


def _sun_grid(furniture: Sequence[Part], first: int) -> tuple[np.ndarray, np.ndarray]:
    """`Scene.casts` and `Scene.cast_ends`; the parts are numbered from `first`."""
    middles = (np.arange(SUN_CELLS) + 0.5) * SUN_CELL - SUN_REACH
    shaded = np.zeros((SUN_CELLS, SUN_CELLS, len(furniture)), bool)
    for number, part in enumerate(furniture):
        beads, radius = _beads(part)
        # Half the diagonal of a cell, and of the sun's square as projected to the end of a shadow.
        reach = radius + 0.71 * SUN_CELL + 0.71 * SUN_SPREAD * MAX_SHADOW
        for column, row in zip(beads @ SUN_ACROSS, beads @ SUN_UP, strict=True):
            shaded[:, :, number] |= np.hypot(middles - column, (middles - row)[:, None]) < reach
    cells, casts = np.nonzero(shaded.reshape(-1, len(furniture)))
    return casts + first, np.searchsorted(cells, np.arange(SUN_CELLS**2 + 1))


def _beads(part: Part) -> tuple[np.ndarray, float]:
    """(B, 3) centres of balls along a part's longest axis that together contain it, and their radius."""
    wide = max(part.taper, 1.0)
    half = np.array(part.half_size) * (wide, wide, 1)
    longest = int(np.argmax(half))
    others = float(np.linalg.norm(np.delete(half, longest)))
    count = max(1, int(half[longest] / max(others, 0.02)))
    steps = (2 * np.arange(count) + 1) / count - 1
    centres = part.centre + steps[:, None] * half[longest] * part.axes[:, longest]
    return centres, float(np.hypot(half[longest] / count, others))


def _reach(part: Part) -> float:
    """Radius of a bounding ball of a part."""
    return float(np.linalg.norm(part.half_size)) * max(part.taper, 1.0)


def _turned(degrees: float) -> np.ndarray:
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


def _world_to_unit(part: Part) -> np.ndarray:
    linear = part.axes.T / np.array(part.half_size)[:, None]
    return np.column_stack([linear, -linear @ part.centre])
