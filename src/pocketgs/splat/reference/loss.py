"""The training losses and their gradients."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate1d

from pocketgs.splat.constants import SSIM_C1, SSIM_C2, SSIM_SIGMA, SSIM_WINDOW
from pocketgs.splat.reference.scene import Scene, SceneGradient
from pocketgs.splat.settings import LossSettings


def ssim_window() -> np.ndarray:
    """(11,) weights of the Gaussian window along one axis; they sum to 1."""
    offsets = np.arange(SSIM_WINDOW) - SSIM_WINDOW // 2
    weights = np.exp(-0.5 * (offsets / SSIM_SIGMA) ** 2)
    return weights / weights.sum()


def _blur(image: np.ndarray) -> np.ndarray:
    """Windowed mean at every pixel whose window is inside the image: (H, W, 3) to (H-10, W-10, 3)."""
    margin = SSIM_WINDOW // 2
    window = ssim_window()
    full = correlate1d(correlate1d(image, window, axis=0, mode="constant"), window, axis=1, mode="constant")
    return full[margin:-margin, margin:-margin]


def _blur_transposed(image: np.ndarray) -> np.ndarray:
    """Adjoint of `_blur`: (H-10, W-10, 3) to (H, W, 3)."""
    margin = SSIM_WINDOW // 2
    window = ssim_window()
    padded = np.pad(image, ((margin, margin), (margin, margin), (0, 0)))
    return correlate1d(correlate1d(padded, window, axis=0, mode="constant"), window, axis=1, mode="constant")


def ssim(rendered: np.ndarray, photo: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean structural similarity (Wang et al. 2004, equation 13) over whole windows and channels, and its gradient.

    Args:
        rendered: (H, W, 3) in [0, 1], each side at least 11.
        photo: (H, W, 3) in [0, 1].

    Returns:
        The mean and its (H, W, 3) gradient with respect to `rendered`.
    """
    mean_x, mean_y = _blur(rendered), _blur(photo)
    energy = _blur(rendered * rendered + photo * photo) - mean_x**2 - mean_y**2
    covariance = _blur(rendered * photo) - mean_x * mean_y
    luminance, luminance_bound = 2 * mean_x * mean_y + SSIM_C1, mean_x**2 + mean_y**2 + SSIM_C1
    structure, structure_bound = 2 * covariance + SSIM_C2, energy + SSIM_C2
    similarity = luminance * structure / (luminance_bound * structure_bound)
    # Derivatives with respect to the windowed means of x, of x² + y² and of xy.
    d_square = -similarity / structure_bound
    d_product = 2 * luminance / (luminance_bound * structure_bound)
    d_mean = (
        2 * similarity * (mean_y / luminance - mean_x / luminance_bound) - 2 * mean_x * d_square - mean_y * d_product
    )
    gradient = (
        _blur_transposed(d_mean) + 2 * rendered * _blur_transposed(d_square) + photo * _blur_transposed(d_product)
    )
    return float(similarity.mean()), gradient / similarity.size


def photometric_loss(
    rendered: np.ndarray, photo: np.ndarray, settings: LossSettings, mask: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Loss of an image and its gradient with respect to `rendered`, both (H, W, 3).

    Pixels outside `mask` (H, W) count as if the photograph equalled the rendering there. Images smaller than a
    window of SSIM have no structural term.
    """
    if mask is not None:
        photo = np.where(mask[..., None], photo, rendered)
    difference = rendered - photo
    if settings.photometric == "l2":
        return float(np.mean(difference**2)), 2 * difference / difference.size
    structural = settings.dssim_weight if min(rendered.shape[:2]) >= SSIM_WINDOW else 0.0
    loss = (1 - structural) * float(np.mean(np.abs(difference)))
    gradient = (1 - structural) * np.sign(difference) / difference.size
    if structural:
        similarity, d_similarity = ssim(rendered, photo)
        loss += structural * (1.0 - similarity)
        gradient = gradient - structural * d_similarity
    if mask is not None:
        gradient = gradient * mask[..., None]
    return loss, gradient


def regularise(scene: Scene, settings: LossSettings, gradient: SceneGradient) -> float:
    """Value of λ_s mean ‖log s‖² + λ_α mean α (the PocketGS paper's total loss); adds its gradient in place.

    The paper sums over the Gaussians; with the mean, weights do not depend on their number.
    """
    count = max(len(scene.means), 1)
    opacities = 1.0 / (1.0 + np.exp(-scene.opacity_logits))
    gradient.log_scales += 2 * settings.scale_weight / count * scene.log_scales
    gradient.opacity_logits += settings.opacity_weight / count * opacities * (1 - opacities)
    return (
        float(settings.scale_weight * np.sum(scene.log_scales**2) + settings.opacity_weight * opacities.sum()) / count
    )
