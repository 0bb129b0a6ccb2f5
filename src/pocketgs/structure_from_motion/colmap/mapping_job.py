"""What COLMAP's mapping is asked and answers, as JSON between two processes."""

from __future__ import annotations

from typing import Literal, TypedDict

MapperName = Literal["incremental", "global"]


class MappedImage(TypedDict):
    """An image.

    Attributes:
        name: of the image.
        features: its .npz file.
    """

    name: str
    features: str


class MappedCamera(TypedDict):
    """A camera of one or more images.

    Attributes:
        model: COLMAP's name of the requested lens model.
        focal_length: in pixels of the reduced images.
        focal_length_is_known: whether it is stated, and not guessed.
        size: width and height of the reduced images.
        full_size: width and height of the full images.
        images: taken with it.
    """

    model: str
    focal_length: float
    focal_length_is_known: bool
    size: list[int]
    full_size: list[int]
    images: list[MappedImage]


class MappingJob(TypedDict):
    """An attempt to find the poses of images.

    Attributes:
        database: file, created and filled with `cameras` if missing.
        model: output folder for the model of the full images in its final world.
        raw_model: output folder for that of the reduced images in COLMAP's world.
        cameras: with their images.
        places: in metres, by image name.
        matches: files with matches of pairs, see `match_file`, in addition to those of other pairs earlier; empty to
            verify all of these again.
        least_matches: minimum number of matches per pair.
        mapper: adds one image after the other, or places all at once.
        refine_lenses: or keep what cameras state.
        go_on: whether to register more images in an earlier `raw_model`.
        better_than: number of placed images that must be exceeded to write a model.
        seed: random seed.
    """

    database: str
    model: str
    raw_model: str
    cameras: list[MappedCamera]
    places: dict[str, list[float]]
    matches: list[str]
    least_matches: int
    mapper: MapperName
    refine_lenses: bool
    go_on: bool
    better_than: int
    seed: int


class _Matched(TypedDict):
    placed: list[str]
    matched_pairs: int
    parallax_pairs: int
    without_parallax: list[str]
    stands_still: bool


class MappingOutcome(_Matched, total=False):
    """The result of an attempt; without a model there are only the first five.

    Attributes:
        placed: names of the images with a pose.
        matched_pairs: number of pairs that match.
        parallax_pairs: number of those whose matches no homography explains.
        without_parallax: names of the images nearly all of whose matching pairs homographies explain: the camera only
            turned there, or saw one flat surface.
        stands_still: whether the camera does.
        points: number of points.
        reprojection_error: mean, in pixels of the full images.
        track_length: mean number of images per point.
        contradicted: number of images that the model was joined to, although their matches contradict it.
        other_models: numbers of images of models that do not fit together with this one.
        metric: whether the world is in metres.
        lenses_refined: whether the lenses were found from the photographs.
    """

    points: int
    reprojection_error: float
    track_length: float
    contradicted: int
    other_models: list[int]
    metric: bool
    lenses_refined: bool
