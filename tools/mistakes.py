"""Captures with typical beginners' mistakes, one each, in the demo's room: for tests and for the docs.

Poses are true unless they are the mistake. Photographs have a phone's noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic.folder import write_frames
from pocketgs.capture.synthetic.materials import STRIPES
from pocketgs.capture.synthetic.phone import READ_NOISE, SHOT_NOISE, expose, quantised
from pocketgs.capture.synthetic.room import WALL, furnished, room
from pocketgs.capture.synthetic.scene import Finish, assemble, ball, box, upright
from pocketgs.capture.synthetic.tracing import Scene
from pocketgs.capture.synthetic.walk import LOOK_AT, true_camera
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at

STRETCH = (6.0, 18.0)
"""Seconds of the walk that these captures cover: some 75 degrees of the arc."""

HELD_OUT = (4, 12)
"""Indices of the held-out frames: none at an end, where rendering would be extrapolation."""

SAMPLES, BLURRED_SAMPLES = 4, 16
SHAKE = np.radians(7)
"""Angle by which a swung phone turns during the exposure."""

STRANGER = 9
"""Index of the photograph of another place."""

PASSES_EVERY = 3
"""Every third photograph has the passer-by in it."""

STOPS_APART = 2.0
WRONG_BY = 0.2
"""Metres."""

NIGHT, AMPLIFIED = 1 / 600, 0.3
"""Light level relative to day; and display values after amplification, relative to day."""


@dataclass(frozen=True)
class Taken:
    """A photograph with its true and its stated camera.

    Attributes:
        scene: the scene in it.
        camera: the true camera.
        believed: the camera that is written to the capture.
        gain: factor on display-referred values.
        light: factor on the light, which the sensor compensates by amplification.
        turn: angle in radians by which the camera turns during the exposure.
    """

    scene: Scene
    camera: Camera
    believed: Camera
    gain: float = 1.0
    light: float = 1.0
    turn: float = 0.0


def _good(cameras: Sequence[Camera]) -> list[Taken]:
    scene = room()
    return [Taken(scene, camera, camera) for camera in cameras]


def _turning(cameras: Sequence[Camera]) -> list[Taken]:
    """Rotation on the spot, from one wall to the other."""
    eye = cameras[len(cameras) // 2].centre
    ahead = np.arctan2(*(LOOK_AT - eye)[1::-1])
    angles = ahead + np.linspace(-0.6, 0.6, len(cameras))
    towards = np.stack([np.cos(angles), np.sin(angles), np.full(len(angles), -0.3)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    turned = [
        replace(camera, world_to_camera=look_at(eye, eye + way, up))
        for camera, way in zip(cameras, towards, strict=True)
    ]
    return _good(turned)


def _two(cameras: Sequence[Camera]) -> list[Taken]:
    middle = len(cameras) // 2
    return _good([cameras[middle - 1], cameras[middle]])


def _duplicates(cameras: Sequence[Camera]) -> list[Taken]:
    """Every photograph three times, as from a phone that was held still now and then."""
    return _good([camera for camera in cameras[::3] for _ in range(3)][: len(cameras)])


def _blank(cameras: Sequence[Camera]) -> list[Taken]:
    """A white cupboard between white walls, on a white floor."""
    white = Finish((0.93, 0.92, 0.9))
    shell = [
        box((2.5, -2.5, -0.05), (6.5, 6.5, 0.05), white),
        box((2.5, WALL + 0.05, 1.6), (6.5, 0.05, 1.6), white),
        box((-WALL - 0.05, -2.5, 1.6), (0.05, 6.5, 1.6), white),
    ]
    scene = assemble(shell, [box((0.55, WALL - 0.19, 0.3), (0.48, 0.19, 0.3), white, dimming=0.3)])
    return [Taken(scene, camera, camera) for camera in cameras]


def _displaced(cameras: Sequence[Camera]) -> list[Taken]:
    """Half of the poses off by 20 cm in a random direction, and so one of every two that are held out."""
    generator = np.random.default_rng(5)
    taken = []
    for number, shot in enumerate(_good(cameras)):
        way = generator.normal(size=3)
        shift = WRONG_BY * way / np.linalg.norm(way) * ((number + number // 8) % 2)
        pose = shot.camera.world_to_camera.copy()
        pose[:3, 3] -= pose[:3, :3] @ shift
        taken.append(replace(shot, believed=replace(shot.camera, world_to_camera=pose)))
    return taken


def _stranger(cameras: Sequence[Camera]) -> list[Taken]:
    """One photograph of another place."""
    taken = _good(cameras)
    elsewhere = look_at(np.array([6.5, -1.0, 1.4]), np.array([7.5, WALL, 1.0]), np.array([0.0, 0.0, 1.0]))
    taken[STRANGER] = replace(taken[STRANGER], camera=replace(taken[STRANGER].camera, world_to_camera=elsewhere))
    return taken


def _flicker(cameras: Sequence[Camera]) -> list[Taken]:
    """Exposure alternates by two stops; held-out photographs have the mean."""
    factor = 2 ** (STOPS_APART / 2 / 2)  # half to either side; a display value is the square root of the light
    gains = [1.0 if number in HELD_OUT else factor ** (-1) ** number for number in range(len(cameras))]
    return [replace(shot, gain=gain) for shot, gain in zip(_good(cameras), gains, strict=True)]


def _mirror(cameras: Sequence[Camera]) -> list[Taken]:
    """A mirror of 1.6 x 1.3 m behind the table."""
    glass = Finish((0.05, 0.05, 0.06), gloss=0.92)
    scene = furnished([box((-0.35, WALL - 0.03, 1.15), (0.8, 0.02, 0.65), glass)])
    return [Taken(scene, camera, camera) for camera in cameras]


def _night(cameras: Sequence[Camera]) -> list[Taken]:
    return [replace(shot, light=NIGHT, gain=AMPLIFIED) for shot in _good(cameras)]


def _swung(cameras: Sequence[Camera]) -> list[Taken]:
    """The phone is swung while a slow shutter is open."""
    return [replace(shot, turn=SHAKE) for shot in _good(cameras)]


def _passer_by(cameras: Sequence[Camera]) -> list[Taken]:
    """A person walks behind the table and back, and is in a third of the photographs, but not in held-out ones."""
    taken = _good(cameras)
    coat, trousers, skin = (
        Finish((0.75, 0.2, 0.15), (0.1, 0.1, 0.1), STRIPES),
        Finish((0.15, 0.2, 0.4)),
        Finish((0.85, 0.65, 0.5)),
    )
    for number in range(1, len(taken), PASSES_EVERY):
        if number in HELD_OUT:
            continue
        x = float(np.interp(number % (len(taken) / 2), (0, len(taken) / 2), (-0.9, 0.9)))
        person = [
            upright((x, 0.75, 0.0), 0.14, 0.85, trousers, taper=1.2, dimming=0.15),
            upright((x, 0.75, 0.85), 0.2, 0.6, coat, dimming=0.2),
            ball((x, 0.75, 1.6), 0.12, skin),
        ]
        taken[number] = replace(taken[number], scene=furnished(person))
    return taken


MISTAKES: dict[str, Callable[[Sequence[Camera]], list[Taken]]] = {
    "none": _good,
    "turning": _turning,
    "two": _two,
    "duplicates": _duplicates,
    "blank": _blank,
    "displaced": _displaced,
    "stranger": _stranger,
    "flicker": _flicker,
    "mirror": _mirror,
    "night": _night,
    "passer-by": _passer_by,
    "swung": _swung,
}
"""Makers of the captures, by name of the mistake."""


def write_mistake(name: str, folder: Path, width: int = 160, height: int = 120, frames: int = 16) -> list[Taken]:
    """Write a capture with one mistake in nerfstudio's format: `transforms.json` and `images/`.

    Args:
        name: one of `MISTAKES`.
        folder: target; it must not exist yet.
        width: of the images, in pixels.
        height: of the images, in pixels.
        frames: number of images, at least ten; "two" writes two.

    Returns:
        The shots, in order.

    Raises:
        PocketGSError: the mistake is unknown.
    """
    if name not in MISTAKES:
        raise PocketGSError(f"mistake: found {name!r}, expected one of {', '.join(MISTAKES)}")
    cameras = [true_camera(time, width, height) for time in np.linspace(*STRETCH, frames).tolist()]
    taken = MISTAKES[name](cameras)
    write_frames(
        folder,
        [
            Frame(f"images/{number:04d}.png", shot.believed, _photographed(shot, number))
            for number, shot in enumerate(taken)
        ],
        HELD_OUT if len(taken) > max(HELD_OUT) else (),
    )
    return taken


def noiseless(shot: Taken) -> np.ndarray:
    """(H, W, 3) float32 display values in [0, 1]: the shot without noise or blur, with its exposure."""
    light, _ = expose(shot.scene, shot.camera, _through(replace(shot, turn=0.0)))
    return np.clip(np.sqrt(light) * np.float32(shot.gain), 0, 1)


def _photographed(shot: Taken, number: int) -> np.ndarray:
    """(H, W, 3) uint8 image from the sensor, with noise."""
    light, _ = expose(shot.scene, shot.camera, _through(shot))
    shown = np.sqrt(light)
    # Less light means fewer photons. After amplification, shot noise grows with the square root and read noise in
    # proportion. A display value is the square root of the light, so amplification also counts by its root.
    spread = np.sqrt(READ_NOISE**2 / shot.light + SHOT_NOISE**2 * np.minimum(shown, 1) / shot.light)
    noise = np.random.default_rng((7, number)).standard_normal(shown.shape, np.float32)
    return quantised(((shown + noise * spread) * shot.gain).astype(np.float32))


def _through(shot: Taken) -> np.ndarray:
    """(S, 3, 4) camera-to-world poses during the exposure."""
    samples = BLURRED_SAMPLES if shot.turn else SAMPLES
    poses = []
    for angle in (shot.turn * np.fft.fftfreq(samples)).tolist():
        sideways = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        pose = shot.camera.camera_to_world[:3].copy()
        pose[:, :3] = pose[:, :3] @ sideways
        poses.append(pose)
    return np.array(poses)
