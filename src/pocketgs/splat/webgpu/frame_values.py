"""The values of the uniform buffers, which the host writes before every image and every step."""

from __future__ import annotations

import math

from numpy.typing import ArrayLike

from pocketgs.geometry.camera import Camera
from pocketgs.gpu.sizes import Symbols, ceil_div
from pocketgs.scene.background import Background
from pocketgs.scene.gaussians import SH_COEFFICIENTS
from pocketgs.splat.constants import SSIM_WINDOW
from pocketgs.splat.engine import KEPT_LOSSES
from pocketgs.splat.settings import StepSettings
from pocketgs.splat.slope_limits import slope_limits
from pocketgs.splat.webgpu.layout import TILE


def view_values(camera: Camera, background: Background, near: float, symbols: Symbols) -> dict[str, ArrayLike]:
    """Fields of the struct `View` for drawing an image; for those of a training step, see `step_values`.

    Args:
        camera: the view to draw.
        background: RGB behind the scene.
        near: minimum depth of drawn Gaussians, see `near_plane`.
        symbols: gives gaussians, coefficients, intersections, replay_depth, and channel_groups where channels are
            composited.
    """
    pose = camera.world_to_camera
    low, high = slope_limits(camera)
    return {
        "to_camera_x": pose[0],
        "to_camera_y": pose[1],
        "to_camera_z": pose[2],
        "centre": (*camera.centre, 1.0),
        "background": (*background, 1.0),
        "focal": (camera.fx, camera.fy),
        "principal": (camera.cx, camera.cy),
        "slopes_low": low,
        "slopes_high": high,
        "width": camera.width,
        "height": camera.height,
        "tiles_across": ceil_div(camera.width, TILE),
        "tiles_down": ceil_div(camera.height, TILE),
        "gaussians": symbols["gaussians"],
        "coefficients": symbols["coefficients"],
        "intersection_capacity": symbols["intersections"],
        "photograph": 0,
        "replay_depth": symbols["replay_depth"],
        "channel_groups": symbols.get("channel_groups", 1),
        "first_tile": 0,
        "dropout_threshold": 0,
        "dropout_seed": 0,
        "near": near,
    }


def step_values(settings: StepSettings, photograph: int) -> dict[str, ArrayLike]:
    """Fields of the struct `View` that a training step sets besides.

    Args:
        settings: with the dropout.
        photograph: where the one that the image is compared with begins, in pixels.
    """
    dropout = settings.dropout
    return {
        "photograph": photograph,
        "dropout_threshold": dropout.threshold if dropout else 0,
        "dropout_seed": dropout.seed if dropout else 0,
    }


def structural_share(settings: StepSettings, camera: Camera) -> float:
    """Weight of 1 - SSIM; 0 for images too small for a window."""
    fits = min(camera.width, camera.height) >= SSIM_WINDOW
    return settings.loss.dssim_weight if settings.loss.photometric == "l1-dssim" and fits else 0.0


def is_regularised(settings: StepSettings) -> bool:
    """Whether the loss has terms of the Gaussians themselves."""
    loss = settings.loss
    return loss.scale_weight != 0.0 or loss.opacity_weight != 0.0 or loss.size_weight != 0.0


def trained_coefficients(settings: StepSettings, coefficients: int) -> int:
    """Coefficients of spherical harmonics per channel that a step trains, of those that there are."""
    return coefficients if settings.sh_degree is None else min(SH_COEFFICIENTS[settings.sh_degree], coefficients)


def update_values(
    settings: StepSettings, camera: Camera, symbols: Symbols, step: int, photograph: int = 0
) -> dict[str, ArrayLike]:
    """Fields of the struct `Update`.

    Args:
        settings: the loss, the rates and Adam's constants.
        camera: gives the image's size.
        symbols: gives gaussians, coefficients and photographs.
        step: number of steps including this one.
        photograph: number of the one that it is compared with.
    """
    loss, rates, adam, noise = settings.loss, settings.rates, settings.adam, settings.noise
    colours = settings.colours
    gaussians, coefficients = max(symbols["gaussians"], 1), symbols["coefficients"]
    structural = structural_share(settings, camera)
    border = SSIM_WINDOW - 1
    channels = 3 * camera.width * camera.height
    windows = 3 * max((camera.width - border) * (camera.height - border), 1)
    squared = loss.photometric == "l2"
    return {
        "absolute_weight": 0.0 if squared else (1.0 - structural) / channels,
        "squared_weight": 1.0 / channels if squared else 0.0,
        "structural_weight": structural / windows,
        "structural_share": structural,
        "scale_weight": loss.scale_weight / gaussians,
        "opacity_weight": loss.opacity_weight / gaussians,
        "size_weight": loss.size_weight / gaussians,
        "mean_rate": rates.means,
        "log_scale_rate": rates.log_scales,
        "rotation_rate": rates.rotations,
        "opacity_rate": rates.opacity_logits,
        "sh_dc_rate": rates.sh_dc,
        "sh_rest_rate": rates.sh_rest,
        "decay1": adam.beta1,
        "decay2": adam.beta2,
        "unbias1": 1.0 / -math.expm1(step * math.log(adam.beta1)) if adam.beta1 > 0.0 else 1.0,
        "unbias2": 1.0 / -math.expm1(step * math.log(adam.beta2)) if adam.beta2 > 0.0 else 1.0,
        "epsilon": adam.epsilon,
        "loss_slot": (step - 1) % KEPT_LOSSES,
        "seen_only": int(adam.seen_only),
        "trained_coefficients": trained_coefficients(settings, coefficients),
        "noise_size": noise.size if noise else 0.0,
        "noise_seed": noise.seed if noise else 0,
        "colours_learned": int(colours is not None),
        "photograph_row": photograph,
        "photographs": symbols["photographs"],
        "colour_rate": colours.rate if colours else 0.0,
        "colour_weight": colours.weight if colours else 0.0,
    }
