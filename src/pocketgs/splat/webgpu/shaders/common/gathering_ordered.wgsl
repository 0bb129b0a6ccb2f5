// The sum of a splat's rows, one per tile that it entered.
fn gather(splat: u32, first_slot: u32, end_slot: u32) -> SplatSums {
    var sums = SplatSums();
    for (var slot = first_slot; slot < end_slot; slot++) {
        let row = read_row(slot);
        sums.exponent += row.exponent;
        sums.offset += row.offset;
        sums.square += row.square;
        sums.colour += row.colour;
    }
    return sums;
}
