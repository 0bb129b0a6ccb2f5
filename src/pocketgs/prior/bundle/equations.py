"""Normal equations of a bundle adjustment: the interface that the CPU and GPU versions implement."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from pocketgs.prior.bundle.reprojection import Estimate, Sightings
from pocketgs.system.device import DeviceName


class CameraEquations(NamedTuple):
    """The cameras' side, of size D = 6 F: each camera's unknowns.

    Attributes:
        matrix: (D, D) H_cc, or the reduced matrix. Only the lower triangle counts.
        right: (D,) b_c, or the reduced right-hand side.
        diagonal: (D,) of H_cc.
        gradient: (D,) b_c.
    """

    matrix: np.ndarray
    right: np.ndarray
    diagonal: np.ndarray
    gradient: np.ndarray


class NormalEquations(Protocol):
    """The equations of one problem, with the points eliminated by the Schur complement.

    Triggs et al., "Bundle adjustment: a modern synthesis" (2000), section 6.1. With H the camera and point blocks of
    JᵀJ and b those of -Jᵀr, the cameras' step solves (H_cc - H_cp H_pp⁻¹ H_pc) δ_c = b_c - H_cp H_pp⁻¹ b_p, and the
    points follow by δ_p = H_pp⁻¹ (b_p - H_pc δ_c).
    """

    def reduced(self, estimate: Estimate, damping: float) -> CameraEquations:
        """The equations for the cameras' step.

        Args:
            estimate: where to linearise.
            damping: the diagonals of H_pp grow by this factor of themselves.
        """

    def point_steps(self, camera_step: np.ndarray) -> tuple[np.ndarray, float]:
        """(N, 3) steps of the points for a step (D,) of the cameras, and the points' part of the expected decrease.

        It belongs to the equations that `reduced` gave last. The decrease is ½ hᵀ (μ D h + b): Madsen, Nielsen and
        Tingleff (2004), equation 3.14.
        """


class Linearizer(Protocol):
    """A device that makes normal equations."""

    name: DeviceName

    def equations(self, sightings: Sightings, huber: float) -> NormalEquations:
        """The equations of a problem.

        Args:
            sightings: the observations.
            huber: length in pixels above which the loss of a residual is linear.
        """

    def release(self) -> None:
        """Give the device's memory back."""
