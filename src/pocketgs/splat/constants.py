"""Constants of the image formation, shared by all engines."""

import numpy as np

NEAR = 0.005
"""Gaussians whose centre is nearer to the camera's plane than this share of the scene's extent are not drawn; see
`pocketgs.splat.near_plane`."""

LOW_PASS = 0.3
"""Added to both variances of a projected Gaussian, in pixels², so that none falls between pixels (3DGS, section 4)."""

MIN_DETERMINANT = 1e-6
"""A projected Gaussian is not drawn if its covariance's determinant is below this fraction of the product of its
variances: float32 cannot represent such a thin needle."""

MAX_VARIANCE = 1e12
"""A projected Gaussian with a larger variance, in pixels², has diverged and is not drawn: float32 cannot represent its
inverse covariance."""

CULLED = np.uint32(0xFFFFFFFF)
"""Depth key of a Gaussian that is not visible."""

FRUSTUM_MARGIN = 0.15
"""Margin around the image, as a fraction of it, beyond which the projection's Jacobian clamps x/z and y/z."""

BRIGHTEST = 1e4
"""A Gaussian with a brighter channel has diverged and is not drawn: it would spoil its neighbours."""

ALPHA_MIN = 1.0 / 255.0
"""Contributions with a smaller α are skipped."""

ALPHA_MAX = 0.99
"""Maximum α of a contribution, so that Gaussians behind it keep a gradient."""

TRANSMITTANCE_MIN = 1e-4
"""Compositing of a pixel stops when its transmittance is below this."""

RADIUS_SIGMAS = 3.0
"""A Gaussian's radius on the image in standard deviations, for statistics (3DGS)."""

SSIM_WINDOW = 11
SSIM_SIGMA = 1.5
SSIM_C1 = 0.01**2
SSIM_C2 = 0.03**2
"""Window and stabilising constants of SSIM for colours in [0, 1] (Wang et al. 2004, section III-B)."""

NOISE_STEEPNESS = 100.0
NOISE_THRESHOLD = 0.005
"""Noise on positions fades at an opacity of 0.005, as steeply as σ(-100 (o - 0.005)) (Kheradmand et al. 2024,
equation 8)."""

ARCTANGENT = (
    0.9999999972,
    -0.3333327629,
    0.1999807528,
    -0.1426001609,
    0.1093234151,
    -0.0834972500,
    0.0570895563,
    -0.0303518651,
    0.0104876494,
    -0.0017011701,
)
"""Polynomial of atan(√u)/√u on [0, 1] in u, from its values at Chebyshev points. Its error is 2e-9."""
