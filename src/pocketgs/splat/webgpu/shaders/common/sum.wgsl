// The compositing rule "sum": in any order, C = Σ c_i α_i + T background, T = Π (1 - α_i). No pixel is ever full.
import appearance.kind

// α - 1/255, so that a splat fades into a pixel from 0, where the exponent (to base 2) is above the cut; else 0. A
// negative transmittance marks what is not in the image.
fn alpha_at(exponent: f32, transmittance: f32) -> f32 {
    let drawn = exponent >= LOG2_ALPHA_MIN && transmittance >= 0.0;
    return select(0.0, max(opacity_at(exponent) - ALPHA_MIN, 0.0), drawn);
}

section forward
import front_to_back.start
// What a pixel has gathered so far is a sum and the transmittance.
fn with_splat(gathered: vec4f, alpha: f32, colour: vec3f, weight: f32) -> vec4f {
    return vec4f(gathered.rgb + alpha * colour, gathered.a - alpha * gathered.a);
}

// Whether a pixel takes more splats.
fn takes_more(gathered: vec4f) -> bool {
    return true;
}

// The finished pixel: the sum over the background, and the transmittance.
fn composited(gathered: vec4f) -> vec4f {
    return vec4f(gathered.rgb + gathered.a * view.background.rgb, gathered.a);
}

section backward
// What lies in front or behind does not enter the gradient, only T (background · ∂L/∂C + ∂L/∂T) with the finished
// pixel's T. The background is 0 where channels are summed, so ∂L/∂T alone counts.
fn first_behind(pixel: vec4f, d_pixel: vec4f) -> f32 {
    return pixel.a * d_pixel.a;
}

// What a splat adds to a pixel's channels.
fn weight_of(alpha: f32, transmittance: f32) -> f32 {
    return alpha;
}

// What the next splat finds in place of the transmittance and of H.
fn transmittance_behind(transmittance: f32, weight: f32) -> f32 {
    return transmittance;
}

fn rest_behind(behind: f32, gain: f32) -> f32 {
    return behind;
}

// The derivative by the logarithm of the opacity before the cut, a = α + 1/255: a ∂L/∂α = a (D - H / (1 - α)), from the
// gain α D. It is 0 where a is clamped.
fn d_log_alpha(gain: f32, behind: f32, alpha: f32) -> f32 {
    let drawn = alpha + ALPHA_MIN;
    return select(0.0, drawn * (gain / alpha - behind / (1.0 - alpha)), alpha < ALPHA_MAX - ALPHA_MIN);
}
