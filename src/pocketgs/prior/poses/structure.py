"""Sparse structure of a capture: triangulated points and refined poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pocketgs.capture.capture import Frame, Photographs
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.adjustment import BundleSettings
from pocketgs.prior.bundle.cpu.equations import CpuLinearizer
from pocketgs.prior.bundle.equations import Linearizer
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.detection import detect_all
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.finder import FeatureFinder
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.features.pairs import choose_pairs
from pocketgs.prior.features.tracks import link, reprojection_errors, triangulate, triangulation_angles
from pocketgs.prior.features.two_view import VERIFICATION, Matches, match_views
from pocketgs.prior.poses.consensus import consensus
from pocketgs.prior.poses.convention import check_adjusted, check_convention
from pocketgs.prior.poses.refinement import refine
from pocketgs.prior.poses.relocalisation import Relocalisation
from pocketgs.prior.poses.robust_adjustment import RobustAdjustment
from pocketgs.prior.poses.suspects import contradicted, unmatched_views
from pocketgs.prior.poses.tolerance import FINEST, MIN_ANGLE, measured_tolerance, widest_tolerance
from pocketgs.prior.scale import Scale
from pocketgs.system.freed_memory import give_back

MAX_STEPS, NEGLIGIBLE_GAIN = 15, 1e-4
"""Adjustment ends after this many steps, or when a step lowers the cost by less than this share: far below noise."""


@dataclass(frozen=True)
class StructureSettings:
    """Settings of structure and motion.

    Attributes:
        bundle: adjust the poses, and relocalise wrong ones; otherwise they stay as given.
        features: maximum number of features per frame.
        position_sigma: standard deviation of given positions, in metres, or if the capture is not metric in units of
            the distance to the scene.
        rotation_sigma: standard deviation of given rotations, in radians.
        fewest_points: minimum number of points for a structure.
    """

    bundle: bool = True
    features: int = 2000
    position_sigma: float = 0.05
    rotation_sigma: float = np.radians(2)
    fewest_points: int = 50

    def __post_init__(self) -> None:
        if self.features < 1:
            raise PocketGSError(f"features: found {self.features}, expected at least 1")

    def bundle_settings(self, scale: Scale) -> BundleSettings:
        """Settings of bundle adjustment at this scale."""
        return BundleSettings(
            iterations=MAX_STEPS,
            position_sigma=self.position_sigma * scale.unit,
            rotation_sigma=self.rotation_sigma,
            tolerance=NEGLIGIBLE_GAIN,
        )


@dataclass(frozen=True, eq=False)
class Structure:
    """Points, and the poses of the frames that see them.

    Attributes:
        names: of the F frames.
        cameras: of the frames.
        points: (N, 3) float64.
        observations: of the points in the frames, consistent with `cameras` within `tolerance`.
        rmse_before, rmse_after: root mean square reprojection error in pixels with the given poses (for replaced
            frames, with their new ones before refinement), and with `cameras`.
        tolerance: maximum reprojection error of an observation, in pixels.
        refined: whether some of `cameras` differ from the given ones.
        adjusted: whether adjustment has moved cameras together, so that points of the given world no longer fit them.
        carried: names of frames that see too few points to be refined, and were moved with the nearest refined frame.
        replaced: names of frames whose given poses were wrong and that were relocalised.
        unplaced: names of frames whose poses the others contradict and that could not be relocalised.
    """

    names: tuple[str, ...]
    cameras: list[Camera]
    points: np.ndarray
    observations: Observations
    rmse_before: float
    rmse_after: float
    tolerance: float
    refined: bool
    adjusted: bool
    carried: tuple[str, ...] = ()
    replaced: tuple[str, ...] = ()
    unplaced: tuple[str, ...] = ()

    def restricted_to(self, frames: Sequence[Frame]) -> Structure:
        """The structure of some of the frames: their cameras, and the points that at least two of them see, renumbered.

        Args:
            frames: some of the frames that it was built from, in any order.
        """
        number = {name: index for index, name in enumerate(self.names)}
        chosen = np.array([number[frame.name] for frame in frames], np.int64)
        place = np.full(len(self.names), -1, np.int32)
        place[chosen] = np.arange(len(chosen))
        inside = place[self.observations.frame] >= 0
        kept = np.bincount(self.observations.point[inside], minlength=len(self.points)) >= 2
        numbers = np.cumsum(kept, dtype=np.int32) - 1
        seen = self.observations.select(inside & kept[self.observations.point])
        return replace(
            self,
            names=tuple(self.names[index] for index in chosen),
            cameras=[self.cameras[index] for index in chosen],
            points=self.points[kept],
            observations=Observations(place[seen.frame], numbers[seen.point], seen.pixels),
        )

    def by_frame(self) -> list[Observations]:
        """For each frame the observations in it, in their order."""
        order = np.argsort(self.observations.frame, kind="stable")
        counts = np.bincount(self.observations.frame, minlength=len(self.cameras))
        return [self.observations.select(own) for own in np.split(order, np.cumsum(counts)[:-1])]


def build_structure(
    frames: Sequence[Frame],
    scale: Scale,
    settings: StructureSettings,
    photographs: Photographs | None = None,
    finder: FeatureFinder | None = None,
    linearizer: Linearizer | None = None,
) -> Structure | None:
    """Triangulate points that several frames see, and refine the poses where the points contradict them.

    Args:
        frames: F frames with given poses, including held-out ones: only geometry is used.
        scale: of the scene.
        settings: see `StructureSettings`.
        photographs: the frames' photographs, to detect features in larger images; None to use the frames themselves.
        finder: detects and matches features; None for the CPU.
        linearizer: makes the normal equations of bundle adjustment; None for the CPU.

    Returns:
        None if there is too little texture.

    Raises:
        MisreadPosesError: the frames fit the poses only in another convention.
        PocketGSError: they contradict the poses as a whole.
    """
    finder = finder or CpuFinder()
    names = tuple(frame.name for frame in frames)
    given = [frame.camera for frame in frames]
    features = detect_all(frames, settings.features, finder, photographs)
    finest = FINEST * float(np.median([view.grain for view in features])) if features else FINEST
    pairs = choose_pairs(names, given, features, scale.distance)
    matches = match_views(given, features, pairs, finder)
    positions = [view.pixels for view in features]
    agreement = check_convention(given, positions, matches)
    placed, matches, wrong = _placed(given, features, matches, finest, settings.bundle, scale, finder)
    sound = {pair: found for pair, found in matches.items() if not wrong[list(pair)].any()}
    tracks, _ = link(features, sound)
    del features  # descriptors take 1 MB a frame, and matrices of many frames need the room
    give_back()
    if not len(tracks):
        return None
    cameras, carried = placed, np.zeros(len(frames), bool)
    if settings.bundle:
        how = settings.bundle_settings(scale)
        adjustment = RobustAdjustment(placed, widest_tolerance(given), finest, how, linearizer or CpuLinearizer())
        refinement = refine(adjustment, tracks, [frame.image for frame in frames], scale.distance)
        cameras, carried = refinement.cameras, refinement.carried
    check_adjusted(agreement, cameras, positions, sound)
    tolerance = measured_tolerance(cameras, tracks, finest)
    points, seen = _agreeing(cameras, tracks, tolerance)
    if len(points) < settings.fewest_points:
        return None
    changed = [new is not old for new, old in zip(placed, given, strict=True)]
    return Structure(
        names=names,
        cameras=cameras,
        points=points,
        observations=seen,
        rmse_before=_rmse(placed, triangulate(placed, seen), seen),
        rmse_after=_rmse(cameras, points, seen),
        tolerance=tolerance,
        refined=any(new is not old for new, old in zip(cameras, given, strict=True)),
        adjusted=any(new is not old for new, old in zip(cameras, placed, strict=True)),
        carried=_chosen(names, carried),
        replaced=_chosen(names, changed),
        unplaced=_chosen(names, wrong),
    )


def _placed(
    given: list[Camera],
    features: Sequence[Features],
    matches: Matches,
    finest: float,
    may_move: bool,
    scale: Scale,
    finder: FeatureFinder,
) -> tuple[list[Camera], Matches, np.ndarray]:
    """Cameras, with wrong ones relocalised where possible; all matches; and (F,) bool which remain wrong."""
    tracks, _ = link(features, matches)
    tolerance = max(VERIFICATION * finest, measured_tolerance(given, tracks, finest))
    # Drift accumulates along a walk: errors slightly above the usual do not contradict a pose.
    gross = max(tolerance, widest_tolerance(given) / 2)
    wrong = contradicted(given, features, matches, gross) | unmatched_views(given, features, matches, scale.distance)
    if not (wrong.any() and may_move):
        return given, matches, wrong
    relocalisation = Relocalisation(given, features, matches, wrong, tolerance, scale.distance, finder)
    relocalisation.run()
    return relocalisation.cameras, relocalisation.matches, relocalisation.wrong


def _chosen(names: Sequence[str], which: Sequence[bool] | np.ndarray) -> tuple[str, ...]:
    return tuple(name for name, chosen in zip(names, which, strict=True) if chosen)


def _agreeing(cameras: Sequence[Camera], tracks: Observations, tolerance: float) -> tuple[np.ndarray, Observations]:
    """The points that observations agree on, and those observations."""
    kept = np.flatnonzero(consensus(cameras, tracks, tolerance, MIN_ANGLE).agrees)
    for _ in range(2):
        seen = tracks.select(kept).renumbered()
        points = triangulate(cameras, seen)
        near = reprojection_errors(cameras, points, seen) < tolerance
        views = np.bincount(seen.point[near], minlength=len(points))
        angles = triangulation_angles(cameras, points, seen.select(near))
        kept = kept[near & ((views >= 2) & (angles >= MIN_ANGLE))[seen.point]]
    seen = tracks.select(kept).renumbered()
    return triangulate(cameras, seen), seen


def _rmse(cameras: Sequence[Camera], points: np.ndarray, observations: Observations) -> float:
    errors = reprojection_errors(cameras, points, observations)
    finite = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else 0.0
