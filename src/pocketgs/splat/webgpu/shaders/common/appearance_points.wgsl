// Every Gaussian that can be seen as an opaque dot of fixed size. A splat ends where α = 1/255: that is the dot's edge.
import splat

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
