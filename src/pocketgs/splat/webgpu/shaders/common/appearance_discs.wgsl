// Every Gaussian that can be seen in its true shape, but opaque and with a hard edge. A splat ends where α = 1/255: that
// is the disc's edge.
import splat

// In standard deviations.
const DISC_RADIUS: f32 = 1.5;

fn appear(splat: Splat) -> Splat {
    var disc = splat;
    disc.log2_opacity = 0.0;
    disc.exponents = splat.exponents * (LOG2_ALPHA_MIN / (-0.5 * LOG2_E * DISC_RADIUS * DISC_RADIUS));
    return disc;
}

fn opacity_at(exponent: f32) -> f32 {
    return 1.0;
}
