"""Errors for parts of gsplat's interface that are not supported."""

from __future__ import annotations

from typing import Any, NoReturn

from pocketgs.errors import PocketGSError

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
    raise PocketGSError(f"{what} is not supported by PocketGS: {reason}; see docs/gsplat.md")


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
