// Noise on the position of a transparent Gaussian: size · σ(-k (o - t)) Σ η with η normal (Kheradmand et al. 2024,
// equation 8).
import gaussians, hash

// A standard normal number that depends on the arguments only (Box and Muller 1958).
fn normal_number(seed: u32, row: u32, number: u32) -> f32 {
    let word = pcg_hash(pcg_hash(pcg_hash(seed) ^ row) ^ number);
    let share = (f32(word) + 1.0) / 4294967296.0;
    let turn = f32(pcg_hash(word ^ 0x9e3779b9u)) / 4294967296.0;
    return sqrt(max(0.0, -2.0 * log(share))) * cos(6.283185307179586 * turn);
}

fn noise_of(gaussian: Gaussian, size: f32, seed: u32, i: u32) -> vec3f {
    let opacity = 1.0 / (1.0 + exp(-gaussian.opacity_logit));
    // Clamped where float32 would overflow, and there is no noise to speak of.
    let factor = size / (1.0 + exp(min(NOISE_STEEPNESS * (opacity - NOISE_THRESHOLD), 80.0)));
    let eta = vec3f(normal_number(seed, i, 0u), normal_number(seed, i, 1u), normal_number(seed, i, 2u));
    let axes = axes_of(gaussian.quaternion);
    let variances = exp(2.0 * gaussian.log_scale);
    return factor * (axes * (variances * (eta * axes)));
}
