"""Prior knowledge of the cameras' poses, and the gauge that is fixed without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pocketgs.errors import PocketGSError
from pocketgs.prior.bundle.reprojection import CAMERA_UNKNOWNS, Estimate


@dataclass(frozen=True)
class PosePrior:
    """A Gaussian around each given pose: its cost is ½ Σ weights · deviation².

    Attributes:
        weights: (6 F,) 1/σ² of every unknown of the cameras, 0 without a prior.
        given: the poses that it is centred on.
    """

    weights: np.ndarray
    given: Estimate

    def deviation(self, estimate: Estimate) -> np.ndarray:
        """(6 F,) rotation vector from the given pose (radians), and offset of the centre.

        The derivative of the rotation vector by the rotation step is approximated by the identity, correct to θ²/12;
        the gradient of the cost is exact nevertheless, because a rotation about the rotation vector changes only its
        length.
        """
        turns = Rotation.from_matrix(estimate.rotations @ self.given.rotations.transpose(0, 2, 1)).as_rotvec()
        return np.concatenate([turns, estimate.centres - self.given.centres], axis=1).ravel()

    def cost(self, estimate: Estimate) -> float:
        """½ Σ weights · deviation², comparable to half a squared residual in pixels."""
        return float(0.5 * np.sum(self.weights * self.deviation(estimate) ** 2))


def pose_prior(given: Estimate, position_sigma: float | None, rotation_sigma: float | None) -> PosePrior:
    """Make the prior from standard deviations, in scene units and radians; None means no prior."""
    turn, offset = (0.0 if sigma is None else sigma**-2 for sigma in (rotation_sigma, position_sigma))
    return PosePrior(np.tile(np.repeat([turn, offset], 3), len(given.centres)), given)


def unheld(given: Estimate, positions_known: bool, rotations_known: bool) -> np.ndarray:
    """(6 F,) bool: the unknowns of the cameras that are free.

    Projections do not change when the whole world is rotated, moved or scaled. Known positions fix all of that. Without
    them, the gauge fixes the first camera's centre and, for the scale, the coordinate in which another camera is
    farthest from it. The first camera's rotation is fixed if rotations are not known either.

    Raises:
        PocketGSError: all cameras are in one place.
    """
    free = np.ones((len(given.centres), CAMERA_UNKNOWNS), bool)
    if not positions_known:
        offsets = np.abs(given.centres - given.centres[0])
        if not offsets.any():
            raise PocketGSError("bundle: all cameras are in one place, expected a baseline between them")
        farthest, axis = np.unravel_index(np.argmax(offsets), offsets.shape)
        free[0, 3:] = False
        free[farthest, 3 + axis] = False
        free[0, :3] = rotations_known
    return free.ravel()
