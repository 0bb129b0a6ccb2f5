// Gaussians as they are: the way they are trained.
import splat

fn appear(splat: Splat) -> Splat {
    return splat;
}

fn opacity_at(exponent: f32) -> f32 {
    return min(exp2(min(exponent, 0.0)), ALPHA_MAX);
}
