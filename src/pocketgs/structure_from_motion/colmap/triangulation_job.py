"""What COLMAP's triangulation is asked and answers, as JSON between two processes."""

from __future__ import annotations

from typing import TypedDict


class PosedCamera(TypedDict):
    """The camera of an image.

    Attributes:
        size: width and height in pixels.
        intrinsics: fx, fy, cx, cy.
        world_to_camera: three rows of four.
    """

    size: list[int]
    intrinsics: list[float]
    world_to_camera: list[list[float]]


class TriangulationJob(TypedDict):
    """The sparse cloud of images with known poses.

    Attributes:
        images: their folder.
        masks: folder with their masks, with the images' names plus `.png`, or None; features are sought where masks are
            not black.
        model: output folder.
        database: file to be made.
        pairs: file that names two images a line.
        cameras: by image name.
        max_size: of the images that features are found in, in pixels.
        seed: random seed.
        threads: as in COLMAP.
    """

    images: str
    masks: str | None
    model: str
    database: str
    pairs: str
    cameras: dict[str, PosedCamera]
    max_size: int
    seed: int
    threads: int


class TriangulationOutcome(TypedDict):
    """The result.

    Attributes:
        points: their number.
        reprojection_error: mean, in pixels.
    """

    points: int
    reprojection_error: float
