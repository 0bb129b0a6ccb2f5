// Replay by recomputation: α again from the exponent.
fn begin_replay(pixel: u32, image_index: u32) {
}

fn replay(splat: Splat, entry: u32, pixel: u32, offset: vec2f, transmittance: f32, d_colour: vec3f) -> Contribution {
    let alpha = alpha_at(exponent_at(splat, offset), transmittance);
    return Contribution(alpha, behind[pixel] - alpha * transmittance * dot(splat.colour, d_colour));
}
