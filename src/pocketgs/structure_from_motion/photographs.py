"""Input of COLMAP's process: features of each photograph on a reduced copy, and camera data from EXIF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from pocketgs.capture.decoding.image_file import UndecodableImageError, colour_and_alpha, read_image
from pocketgs.capture.decoding.mask_file import read_mask
from pocketgs.structure_from_motion.exif import Exif, read_exif
from pocketgs.structure_from_motion.features import find_features
from pocketgs.structure_from_motion.pairs import MAX_FOR_ALL_PAIRS
from pocketgs.structure_from_motion.retrieval import FEATURES_OF_AN_IMAGE
from pocketgs.structure_from_motion.work import Count, each

PHONE_FOCAL_RATIO = 0.64
"""Focal length over the diagonal of a phone's main camera, used if EXIF has none. It is refined later."""

FEATURES_OF_FEW, FEATURES_OF_MANY = 8000, 4500
"""Maximum features per image for few images, which are matched exhaustively, and for many: matching takes longest."""


@dataclass(frozen=True)
class Photograph:
    """One image.

    Attributes:
        name: of its file.
        size: width and height of the file.
        reduced_size: width and height of the copy that features were computed on; their coordinates are its pixels.
        exif: camera data.
        features: number of features.
        file: .npz file with their `keypoints`, `descriptors` and `colours`.
        strongest: (N, 128) uint8 descriptors for retrieval.
    """

    name: str
    size: tuple[int, int]
    reduced_size: tuple[int, int]
    exif: Exif
    features: int
    file: Path
    strongest: np.ndarray


def read_photographs(
    images: Path, masks: Path, workspace: Path, max_size: int, threads: int, on_count: Count
) -> list[Photograph]:
    """Compute the features of a folder's images, without those that cannot be decoded.

    Args:
        images: the folder.
        masks: folder with masks, with the images' names plus `.png`; it need not exist.
        workspace: for the features.
        max_size: features are computed in images reduced to this many pixels on the longer side.
        threads: number of threads; each needs memory for one image.
        on_count: called with the number of images done.

    Raises:
        PocketGSError: a mask cannot be decoded.
    """
    paths = sorted(images.iterdir())
    most = FEATURES_OF_FEW if len(paths) <= MAX_FOR_ALL_PAIRS else FEATURES_OF_MANY

    def read(path: Path) -> Photograph | None:
        try:
            size, image, opaque, exif = read_image(path, lambda opened: _reduced(opened, max_size))
        except UndecodableImageError:
            return None
        features = find_features(image, most)
        mask = masks / f"{path.name}.png"
        for usable in (opaque, read_mask(mask) if mask.is_file() else None):
            if usable is not None:
                features = features.within(usable, (image.shape[1], image.shape[0]))
        columns, rows = np.minimum(features.keypoints[:, :2].astype(int), np.array(image.shape[1::-1]) - 1).T
        file = workspace / f"{path.name}.npz"
        np.savez(file, keypoints=features.keypoints, descriptors=features.descriptors, colours=image[rows, columns])
        strongest = features.descriptors[:FEATURES_OF_AN_IMAGE].copy()
        return Photograph(
            path.name, size, (image.shape[1], image.shape[0]), exif, len(features.keypoints), file, strongest
        )

    # Each thread works on its own image; OpenCV's own threads would only compete.
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return list(filter(None, each(paths, read, threads, on_count)))
    finally:
        cv2.setNumThreads(before)


def cameras_of(photographs: Sequence[Photograph]) -> list[list[Photograph]]:
    """Group photographs by camera: those of the same size and with the same camera and field of view in EXIF.

    Digital zoom changes the field of view only: it scales up the middle of the picture.
    """
    groups: dict[tuple, list[Photograph]] = {}
    for photograph in photographs:
        exif = photograph.exif
        ratio = None if exif.focal_ratio is None else round(exif.focal_ratio, 2)
        groups.setdefault((photograph.size, exif.camera, ratio), []).append(photograph)
    return list(groups.values())


def focal_length(photograph: Photograph) -> tuple[float, bool]:
    """Focal length in pixels of the reduced image, and whether EXIF states it."""
    ratio = photograph.exif.focal_ratio
    diagonal = float(np.hypot(*photograph.reduced_size))
    return (ratio or PHONE_FOCAL_RATIO) * diagonal, ratio is not None


def _reduced(image: Image.Image, max_size: int) -> tuple[tuple[int, int], np.ndarray, np.ndarray | None, Exif]:
    """The full size, the reduced image, (H, W, 3) uint8, bools of its opaque pixels at any size, and EXIF data.

    Pixels of half opacity and more are opaque, as in `Frame.usable`; None if the image has no alpha.
    """
    exif, size = read_exif(image), image.size
    factor = min(1.0, max_size / max(size))
    reduced = (max(1, round(size[0] * factor)), max(1, round(size[1] * factor)))
    # JPEG can be decoded at 1/2, 1/4 or 1/8 of its size in a fraction of the time; other formats ignore this.
    image.draft(None, reduced)
    colours, alpha = colour_and_alpha(image)
    if image.size != reduced:
        colours = cv2.resize(colours, reduced, interpolation=cv2.INTER_AREA)
    return size, colours, None if alpha is None else alpha >= 128, exif
