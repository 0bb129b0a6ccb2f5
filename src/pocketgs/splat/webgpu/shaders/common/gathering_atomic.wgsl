// A splat's row holds the sum already.
fn gather(splat: u32, first_slot: u32, end_slot: u32) -> SplatSums {
    return read_row(splat);
}
