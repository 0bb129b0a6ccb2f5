"""Shading of the demo scene, in linear light.

Surfaces are diffuse under a sky with ambient occlusion and a sun with shadows; glossy ones add the sun's highlight
(Phong, 1975) and a reflection of the room with Schlick's approximation (1994) of Fresnel's law.
"""

from __future__ import annotations

import math

from pocketgs.capture.synthetic.materials import colour_at
from pocketgs.capture.synthetic.shapes import BOX, FRUSTUM, Vector, along, dot, normal_and_place, unit_vector
from pocketgs.capture.synthetic.tracing import SUN_SPREAD, TOWARDS_SUN, Scene, into, nearest, sun_cell
from pocketgs.system.compile import part

SUNLIGHT = (1.25, 1.13, 0.94)
SKYLIGHT = (0.4, 0.44, 0.5)
HIGHLIGHT, HIGHLIGHT_EXPONENT = 12.0, 180.0
START_OFF = 1e-4  # metres off a surface, so that it does not shadow itself through rounding


@part
def light_along(
    scene: Scene, origin: Vector, direction: Vector, distance: float, index: int, sun: Vector, spread: float
) -> Vector:
    """Linear RGB along a ray that hits a part, with one reflection.

    `spread` is the width of a pixel at t = 1.
    """
    red, green, blue = 0.0, 0.0, 0.0
    share, travelled = 1.0, 0.0
    for bounce in range(2):
        if bounce == 1:
            distance, index = nearest(scene, scene.everything, 0, len(scene.everything), origin, direction)
        towards = unit_vector(direction)
        if index < 0:
            sky = _sky(towards)
            return (red + share * sky[0], green + share * sky[1], blue + share * sky[2])
        point = along(origin, direction, distance)
        travelled += distance
        normal, albedo = _surface(scene, index, point, towards, travelled * spread)
        start = along(point, normal, START_OFF)
        facing = dot(normal, sun)
        cell = sun_cell(point)
        lit = (
            facing > 0
            and nearest(scene, scene.casts, scene.cast_ends[cell], scene.cast_ends[cell + 1], start, sun)[1] < 0
        )
        direct, ambient = facing if lit else 0.0, _ambient(scene, point, normal)
        cosine = -dot(towards, normal)
        mirrored = along(towards, normal, 2 * cosine)
        gloss = scene.gloss[index]
        mirror = gloss + (1 - gloss) * (1 - cosine) ** 5 if gloss > 0 else 0.0
        highlight = (
            share * HIGHLIGHT * mirror * max(dot(mirrored, sun), 0.0) ** HIGHLIGHT_EXPONENT
            if lit and gloss > 0
            else 0.0
        )
        matt = share * (1 - mirror)
        red += matt * albedo[0] * (direct * SUNLIGHT[0] + ambient * SKYLIGHT[0]) + highlight * SUNLIGHT[0]
        green += matt * albedo[1] * (direct * SUNLIGHT[1] + ambient * SKYLIGHT[1]) + highlight * SUNLIGHT[1]
        blue += matt * albedo[2] * (direct * SUNLIGHT[2] + ambient * SKYLIGHT[2]) + highlight * SUNLIGHT[2]
        if mirror == 0:
            break
        share *= mirror
        origin, direction = start, mirrored
    return (red, green, blue)


@part
def towards_sun(across: float, down: float) -> Vector:
    """Unit direction to a point of the sun's disc, here a square large enough to soften shadows."""
    x = TOWARDS_SUN[0] + SUN_SPREAD * (across - 0.5)
    y = TOWARDS_SUN[1] + SUN_SPREAD * (down - 0.5)
    return unit_vector((x, y, TOWARDS_SUN[2]))


@part
def _surface(scene: Scene, index: int, point: Vector, towards: Vector, width: float) -> tuple[Vector, Vector]:
    """Unit normal and linear albedo at a point of a part; `width` is the size of a pixel there, seen head-on."""
    unit = into(scene, index, point, 1.0)
    shape = scene.shapes[index]
    outward, u, v = normal_and_place(shape, scene.tapers[index], unit)
    matrix = scene.world_to_unit[index]
    # Normals transform by the inverse transpose of the map from the unit shape to the world.
    normal = unit_vector(
        (
            matrix[0, 0] * outward[0] + matrix[1, 0] * outward[1] + matrix[2, 0] * outward[2],
            matrix[0, 1] * outward[0] + matrix[1, 1] * outward[1] + matrix[2, 1] * outward[2],
            matrix[0, 2] * outward[0] + matrix[1, 2] * outward[1] + matrix[2, 2] * outward[2],
        )
    )
    half = (scene.half_sizes[index, 0], scene.half_sizes[index, 1], scene.half_sizes[index, 2])
    if shape == BOX:
        u *= half[1] if outward[0] != 0 else half[0]
        v *= half[1] if outward[2] != 0 else half[2]
    elif shape == FRUSTUM and outward[0] == 0 and outward[1] == 0:
        u, v = u * half[0], v * half[1]
    else:
        u, v = u * half[0], v * half[2]
    paint = scene.paints[index]
    light, dark = (paint[0, 0], paint[0, 1], paint[0, 2]), (paint[1, 0], paint[1, 1], paint[1, 2])
    # A pixel covers more of a slanted surface: use the geometric mean of the two directions.
    slant = max(-dot(normal, towards), 0.1)
    x, y, z = unit[0] * half[0], unit[1] * half[1], unit[2] * half[2]
    shown = colour_at(scene.materials[index], x, y, z, u, v, width / math.sqrt(slant), light, dark)
    return normal, (shown[0] * shown[0], shown[1] * shown[1], shown[2] * shown[2])


@part
def _ambient(scene: Scene, point: Vector, normal: Vector) -> float:
    """Fraction of the skylight that reaches a point: more from above, less near the occluding balls of bulky parts."""
    open_sky = 1.0
    for index in range(len(scene.dimming)):
        ball = scene.dimming[index]
        towards = (ball[0] - point[0], ball[1] - point[1], ball[2] - point[2])
        rise, square = dot(normal, towards), dot(towards, towards)
        disc = ball[3] * ball[3]
        if rise > 0 and disc > 0.004 * square:
            # Fraction of the cosine-weighted hemisphere that a ball fully above the horizon covers (Quilez, 2006).
            open_sky *= 1 - 0.9 * min(disc / square, 1.0) * rise / math.sqrt(square)
    return open_sky * (0.8 + 0.2 * normal[2])


@part
def _sky(direction: Vector) -> Vector:
    """Environment for reflections where the room is open: a bright ceiling, and a tall window with a cross."""
    rise = direction[2]
    turn = math.atan2(direction[1], direction[0])
    across, up = abs(turn + 0.9), abs(rise - 0.42)
    if 0.03 < across < 0.42 and 0.02 < up < 0.3:
        return (2.6, 2.6, 2.5)
    level = 0.28 + 0.25 * max(rise, 0.0)
    return (level, level * 1.02, level * 1.06)
