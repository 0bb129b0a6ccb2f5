// What Gaussians are drawn as.

section splats
import splats
// Gaussians as they are: the way they are trained.

fn appear(splat: Splat) -> Splat {
    return splat;
}

fn opacity_at(exponent: f32) -> f32 {
    return min(exp2(min(exponent, 0.0)), ALPHA_MAX);
}

section points
import splats
// Every Gaussian that can be seen as an opaque dot of fixed size. A splat ends where α = 1/255: that is the dot's edge.

const POINT_RADIUS: f32 = 1.5;

fn appear(splat: Splat) -> Splat {
    var point = splat;
    let exponent = LOG2_ALPHA_MIN / (POINT_RADIUS * POINT_RADIUS);
    point.log2_opacity = 0.0;
    point.exponents = vec3f(exponent, 0.0, exponent);
    return point;
}

fn opacity_at(exponent: f32) -> f32 {
    return 1.0;
}

section discs
import splats
// Every Gaussian that can be seen in its true shape, but opaque and with a hard edge. A splat ends where α = 1/255:
// that is the disc's edge.

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
