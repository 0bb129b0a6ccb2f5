// The compositing rule "over": front to back in order of depth, C = Σ c_i α_i T_i + T background, where T_i is what the
// splats in front of splat i let through. A pixel takes no more once T has fallen below TRANSMITTANCE_MIN.
import appearance.kind

// α where the exponent (to base 2) and the transmittance in front let it be drawn, else 0.
fn alpha_at(exponent: f32, transmittance: f32) -> f32 {
    let drawn = exponent >= LOG2_ALPHA_MIN && transmittance >= TRANSMITTANCE_MIN;
    return select(0.0, opacity_at(exponent), drawn);
}

section forward
import front_to_back.forward
// What a pixel has gathered so far, front to back, is a colour and the transmittance.
fn with_splat(gathered: vec4f, alpha: f32, colour: vec3f, weight: f32) -> vec4f {
    let amount = alpha * gathered.a;
    return vec4f(gathered.rgb + amount * colour, gathered.a - amount);
}

// The finished pixel: colour over the background, and the transmittance.
fn composited(gathered: vec4f) -> vec4f {
    return vec4f(gathered.rgb + gathered.a * view.background.rgb, gathered.a);
}

section backward
import front_to_back.backward
// What a splat adds to a pixel's channels.
fn weight_of(alpha: f32, transmittance: f32) -> f32 {
    return alpha * transmittance;
}

// T behind a splat.
fn transmittance_behind(transmittance: f32, weight: f32) -> f32 {
    return transmittance - weight;
}

// ∂L/∂(ln α) = α ∂L/∂α = α (T D - H / (1 - α)), from the gain α T D; α is flat where it is clamped.
fn d_log_alpha(gain: f32, behind: f32, alpha: f32) -> f32 {
    return select(0.0, gain - behind * (alpha / (1.0 - alpha)), alpha < ALPHA_MAX);
}

section inspection
// What a splat adds to a pixel is α T. The median depth is that of the splat which brings T below one half.
fn is_median(before: f32, after: f32) -> bool {
    return before >= 0.5 && after < 0.5;
}
