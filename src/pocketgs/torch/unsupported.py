"""What of gsplat's contract is not here, said in one way."""

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
"""Arguments of `rasterization` that must be left out, and what they stand for."""


def unsupported(what: str, reason: str) -> NoReturn:
    """Say that something is not supported.

    Raises:
        PocketGSError: always.
    """
    raise PocketGSError(f"{what} is not supported by PocketGS: {reason}; see docs/gsplat.md")


def refuse_arguments(arguments: dict[str, Any]) -> None:
    """Refuse what must be left out.

    Args:
        arguments: by name; None and False count as left out, and so does a global shutter.

    Raises:
        PocketGSError: one is given.
    """
    for name, value in arguments.items():
        if value is None or value is False or getattr(value, "name", None) == "GLOBAL":
            continue
        unsupported(f"rasterization: {name}", INSTEAD[name])


def check_camera_model(camera_model: str) -> None:
    """Refuse a camera model that is not supported.

    Raises:
        PocketGSError: it is none of CAMERA_MODELS.
    """
    if camera_model not in CAMERA_MODELS:
        raise PocketGSError(f"camera_model: found {camera_model!r}, expected one of {', '.join(CAMERA_MODELS)}")
