"""Errors for parts of gsplat's interface that are not supported."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, NoReturn, TypeVar

import torch

from pocketgs.errors import PocketGSError

_Result = TypeVar("_Result")

CAMERA_MODELS = ("pinhole", "ortho", "fisheye")

INSTEAD = {
    "distributed": "several GPUs; every process here renders by itself",
    "with_ut": "projection by the unscented transform; leave it out for projection by the Jacobian",
    "with_eval3d": "falloffs evaluated in the world; leave it out for falloffs on the image",
    "radial_coeffs": "lens distortion; undistort the photographs first",
    "tangential_coeffs": "lens distortion; undistort the photographs first",
    "thin_prism_coeffs": "lens distortion; undistort the photographs first",
    "ftheta_coeffs": "f-theta lenses",
    "rolling_shutter": "rolling shutters",
    "viewmats_rs": "rolling shutters",
}
"""Arguments of `rasterization` that are not supported, and the features that they belong to."""


def unsupported(what: str, reason: str) -> NoReturn:
    """Report that something is not supported.

    Raises:
        PocketGSError: always.
    """
    raise PocketGSError(f"{what} is not supported by PocketGS: {reason}")


def refuse_arguments(arguments: dict[str, Any]) -> None:
    """Refuse unsupported arguments.

    Args:
        arguments: by name; None, False and a global shutter are accepted.

    Raises:
        PocketGSError: one is given.
    """
    for name, value in arguments.items():
        if value is None or value is False or getattr(value, "name", None) == "GLOBAL":
            continue
        unsupported(f"rasterization: {name}", INSTEAD[name])


def check_camera_model(camera_model: str) -> None:
    """Check a camera model.

    Raises:
        PocketGSError: it is not in CAMERA_MODELS.
    """
    if camera_model not in CAMERA_MODELS:
        raise PocketGSError(f"camera_model: found {camera_model!r}, expected one of {', '.join(CAMERA_MODELS)}")


def first_derivative(backward: Callable[..., _Result]) -> Callable[..., _Result]:
    """The `backward` of an autograd function, which refuses to be differentiated itself.

    PyTorch would take what kernels compute for constants, and return wrong second derivatives. Its decorator
    `once_differentiable` notices that only on some paths through the graph.
    """

    @wraps(backward)
    def checked(*arguments: Any) -> _Result:
        if torch.is_grad_enabled():  # only with create_graph=True
            unsupported("create_graph=True", "its functions have no second derivatives")
        return backward(*arguments)

    return checked
