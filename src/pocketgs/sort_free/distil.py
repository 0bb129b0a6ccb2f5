"""Train a sort-free scene to look like a sorted one, its teacher."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.edits import with_sh_degree
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians
from pocketgs.sort_free.forms import FormName
from pocketgs.sort_free.optimiser import ArrayAdam
from pocketgs.sort_free.renderer import SceneGradient, SortFreeImage, SortFreeRenderer
from pocketgs.sort_free.scene import MAX_LOGARITHM, SortFreeScene, sort_free
from pocketgs.sort_free.visibility import fitted_visibility
from pocketgs.splat.choose_engine import chosen_engine
from pocketgs.splat.engine import EngineName, EngineOptions
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.optimiser import Adam, photometric_loss
from pocketgs.splat.rasterizer import Output, Raster, Rasterizer
from pocketgs.system.interrupt import deferred_interrupt
from pocketgs.training.recipes import cosine, recipe_named
from pocketgs.training.view_choice import view_of_step

SOLID = 0.5
"""Minimum coverage of a pixel, in both images, for its depths to be compared."""

RATE = 0.3
"""Learning rates, as a share of the recipe's for a scene from scratch."""

VIEW_RATE, NUMBER_RATE = 0.15, 0.02
"""First learning rates of the harmonics of v, and of the logarithms of the form's numbers."""

BYTES_PER_GAUSSIAN, BYTES_PER_COEFFICIENT, BYTES_PER_VIEW_COEFFICIENT, BYTES_PER_PIXEL = 900, 122, 61, 500
"""Maximum memory of a distillation, as measured on the CPU with 200,000 Gaussians and on images of 1600x1200: per
Gaussian, per coefficient of its colour's and of v's harmonics, and per pixel of a view."""

LARGEST_LOGARITHM = 0.99 * MAX_LOGARITHM
"""Learned logarithms are cut here, so that a file can hold them whichever way it rounds."""


@dataclass(frozen=True)
class DistilOptions:
    """Options of a distillation.

    Attributes:
        compositor: weights of Gaussians. "visibility": the share of each that is seen, from the sorted scene; "lc",
            "exponential" and "direct": the weighted sums of Hou et al.; "mobile": Mobile-GS.
        iterations: training steps, one view each.
        sh_degree: greatest degree of the colours' spherical harmonics.
        view_degree: degree of the spherical harmonics of what each Gaussian's weight depends on.
        teacher_weight: of the mean absolute difference from the sorted scene's image.
        depth_weight: of the scale-invariant squared difference of logarithms of depth.
        seed: of the order of views.
        engine: that draws. "auto" uses a GPU if there is one, else the CPU; "webgpu" accepts software adapters too.
        threads: CPU threads; None for all cores.
        gpu: part of the name of the GPU to use, or None for the best.
    """

    compositor: FormName = "visibility"
    iterations: int = 500
    sh_degree: int = 1
    view_degree: int = 2
    teacher_weight: float = 1.0
    depth_weight: float = 0.1
    seed: int = 0
    engine: EngineName = "auto"
    threads: int | None = None
    gpu: str | None = None

    def __post_init__(self) -> None:
        for name in ("iterations", "seed"):
            if getattr(self, name) < 0:
                raise PocketGSError(f"{name}: found {getattr(self, name)}, expected at least 0")
        for name in ("teacher_weight", "depth_weight"):
            if not 0.0 <= getattr(self, name) < np.inf:
                found = getattr(self, name)
                raise PocketGSError(f"{name.replace('_', ' ')}: found {found}, expected a finite number of at least 0")
        if self.threads is not None and self.threads < 1:
            raise PocketGSError(f"threads: found {self.threads}, expected at least 1")
        for name in ("sh_degree", "view_degree"):
            if getattr(self, name) not in range(4):
                raise PocketGSError(f"{name.replace('_', ' ')}: found {getattr(self, name)}, expected 0 to 3")

    @property
    def engine_options(self) -> EngineOptions:
        """The options of the engine that draws."""
        return EngineOptions(self.engine, self.threads, self.gpu)


Observer = Callable[[str, int, int], None]
"""Called with the stage, the number of its steps that are done, and their total."""


@dataclass(frozen=True)
class Distilled:
    """Result of a distillation: the scene, the number of steps done, and whether Ctrl-C ended it."""

    scene: SortFreeScene
    iterations: int
    interrupted: bool


def distil(
    teacher: Gaussians, capture: Capture, options: DistilOptions | None = None, observer: Observer | None = None
) -> Distilled:
    """Train a scene that looks like the teacher without sorting.

    The loss is that of training, with the distance from the teacher's image and depth (Du et al. 2026). On one engine,
    the result depends on the options alone. Ctrl-C ends training after the current step and keeps the scene.

    Args:
        teacher: a trained scene.
        capture: whose training views are used, with the poses that the scene was trained with.
        options: None for the defaults.
        observer: called after every step.

    Raises:
        PocketGSError: there is no training view, or none shows the scene, or there is no such engine or GPU.
    """
    options = options or DistilOptions()
    if not capture.train:
        raise PocketGSError(f"{capture.path}: no training view, expected at least one")
    if len(teacher) == 0:
        raise PocketGSError("distil: 0 Gaussians, expected at least one")
    return _Distillation(teacher, capture, options, observer or (lambda stage, done, of: None)).run()


def memory_needed(teacher: Gaussians, cameras: Iterable[Camera], options: DistilOptions) -> int:
    """Maximum bytes that `distil` takes besides the teacher and the capture.

    Args:
        teacher: a trained scene.
        cameras: of the training views.
        options: of the distillation.
    """
    colours, views = (
        SH_COEFFICIENTS[degree] for degree in (min(options.sh_degree, teacher.sh_degree), options.view_degree)
    )
    each = BYTES_PER_GAUSSIAN + BYTES_PER_COEFFICIENT * colours + BYTES_PER_VIEW_COEFFICIENT * views
    pixels = max((camera.width * camera.height for camera in cameras), default=0)
    return each * len(teacher) + BYTES_PER_PIXEL * pixels


def typical_distance(teacher: Gaussians, capture: Capture) -> float:
    """Median over cameras of the median distance of Gaussians in front, in scene units.

    Raises:
        PocketGSError: nothing lies in front of any camera.
    """
    medians = []
    for frame in capture.train:
        front = frame.camera.depths(teacher.means) > 0.0
        if front.any():
            offsets = teacher.means[front] - frame.camera.centre
            medians.append(float(np.median(np.linalg.norm(offsets, axis=1))))
    if not medians or not np.median(medians) > 0.0:
        raise PocketGSError(f"{capture.path}: no training view shows the scene: do the poses belong to it?")
    return float(np.median(medians))


class _Distillation:
    def __init__(self, teacher: Gaussians, capture: Capture, options: DistilOptions, observer: Observer) -> None:
        self._teacher, self._capture, self._options, self._observer = teacher, capture, options, observer
        self._near = near_plane(teacher.means)
        engine = chosen_engine(options.engine_options)
        self._sorted = Rasterizer(engine, options.threads, options.gpu)
        self._renderer = SortFreeRenderer(engine, options.threads, options.gpu)

    def run(self) -> Distilled:
        options, capture, scene = self._options, self._capture, self._start()
        recipe = recipe_named("pocketgs")
        cameras = [frame.camera for frame in capture.train]
        first_rates = recipe.rates_for_scene(options.iterations or 1, cameras, self._teacher).scaled(RATE)
        schedule = cosine(final=0.02)
        adam = Adam(scene.gaussians, recipe.adam)
        scene = replace(scene, gaussians=adam.scene)
        visibility_sh = ArrayAdam(scene.visibility_sh, recipe.adam)
        log_shared = ArrayAdam(scene.log_shared, replace(recipe.adam, seen_only=False))
        with deferred_interrupt() as interrupt:
            for number in range(options.iterations):
                if interrupt.requested:
                    return Distilled(scene, number, True)
                rates = schedule(first_rates, number / options.iterations)
                share = rates.means / first_rates.means
                frame = capture.train[view_of_step(number, len(capture.train), options.seed)]
                gradient = self._gradient(scene, frame)
                adam.step(gradient.gaussians, rates)
                visibility_sh.step(gradient.visibility_sh, VIEW_RATE * share)
                log_shared.step(gradient.log_shared, NUMBER_RATE * share)
                np.clip(scene.log_shared, -LARGEST_LOGARITHM, LARGEST_LOGARITHM, out=scene.log_shared)
                self._observer("training", number + 1, options.iterations)
        return Distilled(scene, options.iterations, False)

    def _start(self) -> SortFreeScene:
        options, capture, teacher = self._options, self._capture, self._teacher
        gaussians = with_sh_degree(teacher, min(options.sh_degree, teacher.sh_degree))
        scene = sort_free(gaussians, options.compositor, typical_distance(teacher, capture), options.view_degree)
        if options.compositor != "visibility":
            return scene
        cameras = [frame.camera for frame in capture.train]
        visibility_sh = fitted_visibility(
            teacher,
            cameras,
            options.view_degree,
            self._sorted,
            self._renderer.rasterizer,
            lambda done, of: self._observer("visibility", done, of),
        )
        return replace(scene, visibility_sh=visibility_sh)

    def _gradient(self, scene: SortFreeScene, frame: Frame) -> SceneGradient:
        options, background = self._options, self._capture.background
        with_depth = options.depth_weight > 0.0
        image = self._renderer.forward(scene, frame.camera, background, depth=with_depth, near=self._near)
        _, d_rgb = photometric_loss(image.rgb, frame.image, mask=frame.mask)
        d_depth = None
        if options.teacher_weight > 0.0 or with_depth:
            wanted: tuple[Output, ...] = ("rgb", "alpha", "depth") if with_depth else ("rgb",)
            seen = self._sorted.forward(self._teacher, frame.camera, wanted, background=background, near=self._near)
            counts = np.ones(image.alpha.shape, bool) if frame.mask is None else frame.mask
            assert seen.rgb is not None
            sides = np.sign(image.rgb - seen.rgb) * counts[..., None]
            d_rgb = d_rgb + np.float32(options.teacher_weight / sides.size) * sides
            if with_depth:
                d_depth = options.depth_weight * _d_log_depth(image, seen, counts)
        return self._renderer.backward(image, rgb=d_rgb, depth=d_depth)


def _d_log_depth(image: SortFreeImage, seen: Raster, counts: np.ndarray) -> np.ndarray:
    """(H, W) gradient of mean g² - ½ (mean g)², g the difference of the depths' logarithms (Eigen et al. 2014)."""
    assert image.depth is not None
    assert seen.depth is not None
    assert seen.alpha is not None
    solid = counts & (seen.alpha > SOLID) & (image.alpha > SOLID) & (seen.depth > 0.0) & (image.depth > 0.0)
    gradient = np.zeros_like(image.depth)
    if solid.any():
        depths = image.depth[solid]
        differences = np.log(depths / seen.depth[solid])
        gradient[solid] = (2.0 * differences - differences.mean()) / (len(depths) * depths)
    return gradient
