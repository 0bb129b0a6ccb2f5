"""Colour transforms of the photographs: application, gradients and updates."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.colours import CHANGE, FIRST_MOMENTS, SECOND_MOMENTS, UPDATES
from pocketgs.splat.settings import AdamSettings, ColourSettings


def transformed(image: np.ndarray, transform: np.ndarray) -> np.ndarray:
    """(H, W, 3) A c + b of each colour c, for the (3, 4) transform [A | b]."""
    return image @ transform[:, :3].T + transform[:, 3]


def transformed_backward(
    image: np.ndarray, transform: np.ndarray, d_transformed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gradients with respect to the arguments of `transformed`, from that with respect to its result.

    Returns:
        (H, W, 3) and (3, 4).
    """
    d_matrix = np.einsum("hwi,hwj->ij", d_transformed, image)
    d_offset = d_transformed.sum(axis=(0, 1))
    return d_transformed @ transform[:, :3], np.concatenate([d_matrix, d_offset[:, None]], axis=1)


def learn_transform(
    table: np.ndarray, view: int, gradient: np.ndarray, settings: ColourSettings, adam: AdamSettings
) -> None:
    """Update a photograph's transform by one step of Adam, in place, and reset the mean of all to the identity.

    Args:
        table: (V, COLUMNS), see `pocketgs.splat.colours`.
        view: index of the photograph.
        gradient: (3, 4) of the loss.
        settings: the rate, and the weight of the regularisation towards the identity.
        adam: settings of Adam; `seen_only` has no effect.
    """
    row = table[view].astype(np.float64)
    change, first, second = row[CHANGE], row[FIRST_MOMENTS], row[SECOND_MOMENTS]
    slope = np.ravel(gradient) + 2.0 * settings.weight * change
    row[UPDATES] += 1.0
    first += (1.0 - adam.beta1) * (slope - first)
    second += (1.0 - adam.beta2) * (slope * slope - second)
    mean = first / (1.0 - adam.beta1 ** row[UPDATES])
    spread = np.sqrt(second / (1.0 - adam.beta2 ** row[UPDATES]))
    change -= settings.rate * mean / (spread + adam.epsilon)
    table[view] = row
    table[:, CHANGE] -= table[:, CHANGE].mean(axis=0, dtype=np.float64).astype(table.dtype)
