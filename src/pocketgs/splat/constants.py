"""Numbers of the image formation that every engine shares."""

NEAR = 0.005
"""Gaussians whose centre is nearer to the camera's plane than this share of the scene's extent are not drawn; see
`pocketgs.splat.near_plane`."""

LOW_PASS = 0.3
"""Added to both variances of a projected Gaussian, in pixels², so that none falls between pixels (3DGS, section 4)."""

MIN_DETERMINANT = 1e-6
"""A projected Gaussian whose covariance has a determinant under this times the product of its variances is a needle
thinner than float32 can hold, and is not drawn."""

MAX_VARIANCE = 1e12
"""A projected Gaussian with a larger variance, in pixels², has diverged and is not drawn: float32 could not hold its
inverse covariance."""

FRUSTUM_MARGIN = 0.15
"""Fraction of the image by which x/z and y/z may leave the image before the projection's Jacobian clamps them."""

BRIGHTEST = 1e4
"""A Gaussian with a channel brighter than this has diverged and is not drawn: it would spoil its neighbours."""

ALPHA_MIN = 1.0 / 255.0
"""Contributions more transparent than this are skipped."""

ALPHA_MAX = 0.99
"""No single contribution is more opaque than this, so that what lies behind keeps a gradient."""

TRANSMITTANCE_MIN = 1e-4
"""A pixel whose transmittance has fallen below this takes no more contributions."""

RADIUS_SIGMAS = 3.0
"""Standard deviations that a Gaussian's radius on the image stands for in statistics (3DGS)."""

SSIM_WINDOW = 11
SSIM_SIGMA = 1.5
SSIM_C1 = 0.01**2
SSIM_C2 = 0.03**2
"""Window and stabilising constants of SSIM for colours in [0, 1] (Wang et al. 2004, section III-B)."""

NOISE_STEEPNESS = 100.0
NOISE_THRESHOLD = 0.005
"""Noise on positions fades at an opacity of 0.005, as steeply as σ(-100 (o - 0.005)) (Kheradmand et al. 2024,
equation 8)."""
