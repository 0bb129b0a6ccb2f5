// Replay by recomputation: α again from the exponent.
fn begin_replay(pixel: u32, image_index: u32) {
}

fn replayed_alpha(pixel: u32, entry: u32, exponent: f32, transmittance: f32) -> f32 {
    return alpha_at(exponent, transmittance);
}
