// gsplat's compositing rule: "over", where α is at most GSPLAT_ALPHA_MAX, and a pixel takes neither the splat that would
// bring T below TRANSMITTANCE_MIN nor any behind it. The transmittance of such a pixel is held as -T.

// α where the exponent (to base 2) and the transmittance in front let it be drawn, else 0.
fn alpha_at(exponent: f32, transmittance: f32) -> f32 {
    let drawn = exponent >= LOG2_ALPHA_MIN && transmittance >= TRANSMITTANCE_MIN;
    return select(0.0, min(exp2(min(exponent, 0.0)), GSPLAT_ALPHA_MAX), drawn);
}

section forward
import front_to_back.forward
// What a pixel has gathered so far, front to back, is a colour and the transmittance.
fn with_splat(gathered: vec4f, alpha: f32, colour: vec3f, weight: f32) -> vec4f {
    let amount = alpha * gathered.a;
    let rest = gathered.a - amount;
    if (rest <= TRANSMITTANCE_MIN) {
        return vec4f(gathered.rgb, -gathered.a);
    }
    return vec4f(gathered.rgb + amount * colour, rest);
}

// The finished pixel: colour over the background, and the transmittance.
fn composited(gathered: vec4f) -> vec4f {
    let transmittance = abs(gathered.a);
    return vec4f(gathered.rgb + transmittance * view.background.rgb, transmittance);
}

section backward
import front_to_back.backward
// What a splat adds to a pixel's channels, negative if the pixel takes neither it nor any behind it.
fn weight_of(alpha: f32, transmittance: f32) -> f32 {
    let weight = alpha * transmittance;
    return select(weight, -1.0, transmittance - weight <= TRANSMITTANCE_MIN);
}

// T behind a splat.
fn transmittance_behind(transmittance: f32, weight: f32) -> f32 {
    return select(transmittance - weight, -transmittance, weight < 0.0);
}

// ∂L/∂(ln α) = α (T D - H / (1 - α)), from the gain α T D; α is flat where it is clamped.
fn d_log_alpha(gain: f32, behind: f32, alpha: f32) -> f32 {
    return select(0.0, gain - behind * (alpha / (1.0 - alpha)), alpha < GSPLAT_ALPHA_MAX);
}
