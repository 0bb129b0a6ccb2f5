"""Make the pictures of docs/photographing.md: captures with one mistake each in the demo's room, and the results.

Every picture shows, from left to right: the room from above with the cameras, green where many of them look and red
where few do; two of the photographs; and the trained scene, from a position between two photographs or a step aside.
The scenes are made by the real pipeline with small settings. Its output is printed.

    python tools/photographing.py                      # all pictures; some minutes on two cores
    python tools/photographing.py turning night        # some of them
    python tools/photographing.py --work FOLDER        # keeps captures and results there, and reuses them
"""

from __future__ import annotations

import argparse
import pickle
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from mistakes import MISTAKES, write_mistake
from pocketgs.capture import list_capture
from pocketgs.capture.synthetic.phone import expose, quantised
from pocketgs.capture.synthetic.room import room
from pocketgs.capture.synthetic.walk import LOOK_AT
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import run
from pocketgs.scene.formats import read_scene
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.rendering import render
from pocketgs.training.options import TrainingOptions

IMAGES = Path(__file__).parents[1] / "docs" / "images"
SHOWN = ("none", "turning", "swung", "night", "blank", "mirror", "flicker", "passer-by")
"""The mistakes shown on the page."""

OPTIONS = TrainingOptions(effort="quick", iterations=200, max_gaussians=15_000, engine="cpu")
PANEL = (240, 180)
GAP, QUALITY = 6, 82

ABOVE, SPAN, HEIGHT = 12.0, 5.6, 0.7
"""Metres: height of the view from above, its extent, and the height at which views are counted."""

WEDGE = 0.35
"""Length in metres of the drawn camera wedges."""

FULL = 8
"""Number of cameras at which the map is fully green."""

ASIDE = {"turning": 0.8, "blank": 0.8, "mirror": 0.8}
"""Metres to the side of the cameras, for scenes that look right only from the cameras' positions."""


def main() -> None:
    """Make the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mistakes", nargs="*", help=f"which: {', '.join(SHOWN)}")
    parser.add_argument("--work", type=Path, help="folder for captures and results, to be used again")
    parser.add_argument("--output", type=Path, default=IMAGES, help="folder for the pictures")
    arguments = parser.parse_args()
    if unknown := set(arguments.mistakes) - set(MISTAKES):
        parser.error(f"found {', '.join(sorted(unknown))}, expected some of {', '.join(MISTAKES)}")
    arguments.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        for mistake in arguments.mistakes or SHOWN:
            picture = _picture(mistake, (arguments.work or Path(temporary)) / mistake)
            picture.save(arguments.output / f"photographing-{mistake}.jpg", quality=QUALITY, optimize=True)


def _picture(mistake: str, folder: Path) -> Image.Image:
    cameras = _trained(mistake, folder)
    photographs = sorted((folder / "capture" / "images").iterdir())
    third = len(photographs) // 3
    panels = [
        _plan(cameras),
        *(Image.open(photographs[index]) for index in (third, 2 * third)),
        _scene(folder / "result" / "scene.ply", cameras, ASIDE.get(mistake, 0.0)),
    ]
    width, height = PANEL
    picture = Image.new("RGB", (len(panels) * (width + GAP) - GAP, height), "white")
    for number, panel in enumerate(panels):
        picture.paste(panel.convert("RGB").resize(PANEL, Image.Resampling.BICUBIC), (number * (width + GAP), 0))
    return picture


def _trained(mistake: str, folder: Path) -> list[Camera]:
    """Make the capture and train on it unless that was done; returns the true cameras."""
    kept = folder / "cameras.pickle"
    if not kept.exists():
        cameras = [shot.camera for shot in write_mistake(mistake, folder / "capture")]
        kept.write_bytes(pickle.dumps(cameras))
    if not (folder / "result" / "run.json").exists():
        print(f"{mistake}:")
        reporter = Reporter(
            on_warning=lambda warning: print(f"  {warning}"),
            on_prior=lambda report: print(*(f"  {warning}" for warning in report.warnings), sep="\n"),
        )
        try:
            result = run(lambda: list_capture(folder / "capture"), folder / "result", OPTIONS, reporter=reporter)
            print(f"  PSNR {result.summary['psnr']:.2f} dB, covered {result.summary['coverage']:.1%}")
        except PocketGSError as error:
            print(f"  refused: {error}")
    cameras = pickle.loads(kept.read_bytes())
    assert isinstance(cameras, list)
    return cameras


def _plan(cameras: list[Camera]) -> Image.Image:
    """The room from above, coloured by how many cameras look at each place, with the cameras."""
    side = 2 * PANEL[1]
    focal = side * ABOVE / SPAN
    centre = np.array([-0.1, -0.1, ABOVE])
    pose = look_at(centre, centre - (0, 0, 1), np.array([0.0, 1.0, 0.0]))
    above = Camera(2 * PANEL[0], side, focal, focal, PANEL[0], PANEL[1], pose)
    light, _ = expose(room(), above, above.camera_to_world[None, :3])
    shown = np.sqrt(light).mean(axis=2, keepdims=True)
    seen = _seen(above, cameras)
    green, red = np.array([0.2, 0.85, 0.35]), np.array([0.95, 0.25, 0.15])
    tint = green * seen[..., None] + red * (1 - seen[..., None])
    plan = Image.fromarray(quantised((0.55 * shown + 0.45 * tint * (0.4 + 0.6 * shown)).astype(np.float32)))
    draw = ImageDraw.Draw(plan)
    for camera in cameras:
        half = 0.5 * camera.width / camera.fx
        corners = [camera.centre + WEDGE * camera.camera_to_world[:3, :3] @ (x, 0, 1) for x in (-half, half)]
        eye, left, right = above.project(np.array([camera.centre, *corners]))[0]
        draw.polygon([tuple(eye), tuple(left), tuple(right)], fill=(255, 255, 255), outline=(20, 30, 60))
    return plan


def _seen(above: Camera, cameras: list[Camera]) -> np.ndarray:
    """(H, W) in [0, 1]: number of directions from which each place at `HEIGHT` is seen."""
    rows, columns = np.indices((above.height, above.width))
    rays = above.rays(np.column_stack([columns.ravel(), rows.ravel()]) + 0.5)
    points = above.centre + rays * (ABOVE - HEIGHT)
    count = np.zeros(len(points))
    places = {tuple(np.round(camera.centre, 1)): camera for camera in cameras}
    share = len(places) / len(cameras)
    for camera in cameras:
        pixels, depth = camera.project(points)
        count += share * ((depth > 0) & np.all((pixels >= 0) & (pixels < (camera.width, camera.height)), axis=1))
    return np.clip(count / FULL, 0, 1).reshape(above.height, above.width)


def _scene(path: Path, cameras: list[Camera], aside: float) -> Image.Image:
    """The trained scene from between two cameras and `aside` metres to their left; grey if there is none."""
    if not path.exists():
        return Image.new("RGB", PANEL, (60, 60, 60))
    one, other = cameras[len(cameras) // 2 - 1 :][:2]
    eye = (one.centre + other.centre) / 2 - aside * one.camera_to_world[:3, 0]
    target = LOOK_AT if aside else eye + one.forward + other.forward
    pose = look_at(eye, target, np.array([0.0, 0.0, 1.0]))
    image = render(read_scene(path), replace(one, world_to_camera=pose), engine=EngineOptions("cpu")).image
    return Image.fromarray(quantised(image))


if __name__ == "__main__":
    main()
