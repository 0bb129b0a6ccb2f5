// The compositing rule "over": front to back in order of depth, C = Σ c_i α_i T_i + T background, where T_i is what the
// splats in front of splat i let through. A pixel takes no more once T has fallen below TRANSMITTANCE_MIN.
import appearance.kind

// α where the exponent (to base 2) and the transmittance in front let it be drawn, else 0.
fn alpha_at(exponent: f32, transmittance: f32) -> f32 {
    let drawn = exponent >= LOG2_ALPHA_MIN && transmittance >= TRANSMITTANCE_MIN;
    return select(0.0, opacity_at(exponent), drawn);
}

section forward
// What a pixel has gathered so far, front to back, is a colour and the transmittance, which is 0 beside the image.
fn nothing_yet(inside: bool) -> vec4f {
    return vec4f(vec3f(), select(0.0, 1.0, inside));
}

fn with_splat(gathered: vec4f, alpha: f32, colour: vec3f, weight: f32) -> vec4f {
    let amount = alpha * gathered.a;
    return vec4f(gathered.rgb + amount * colour, gathered.a - amount);
}

// Whether a pixel takes more splats.
fn takes_more(gathered: vec4f) -> bool {
    return gathered.a >= TRANSMITTANCE_MIN;
}

// The finished pixel: colour over the background, and the transmittance.
fn composited(gathered: vec4f) -> vec4f {
    return vec4f(gathered.rgb + gathered.a * view.background.rgb, gathered.a);
}

section backward
// The gradient by replaying in the same order. With D_i = c_i · ∂L/∂C, what lies behind splat i enters its gradient
// only through the number H_i = Σ_{j>i} w_j D_j + T (background · ∂L/∂C + ∂L/∂T). It starts at C · ∂L/∂C + T ∂L/∂T,
// with the finished pixel's C and T, and loses w_i D_i at every contribution. T and H are all that a replay carries.
fn first_behind(pixel: vec4f, d_pixel: vec4f) -> f32 {
    return dot(pixel, d_pixel);
}

// What a splat adds to a pixel's channels.
fn weight_of(alpha: f32, transmittance: f32) -> f32 {
    return alpha * transmittance;
}

// T and H behind a splat.
fn transmittance_behind(transmittance: f32, weight: f32) -> f32 {
    return transmittance - weight;
}

fn rest_behind(behind: f32, gain: f32) -> f32 {
    return behind - gain;
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
