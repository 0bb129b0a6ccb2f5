// Replay by recomputation: the forward pass keeps nothing.
fn remember(pixel: u32, contribution: u32, entry: u32, alpha: f32, colour: vec3f) {
}

fn remember_count(pixel: u32, contributions: u32) {
}
