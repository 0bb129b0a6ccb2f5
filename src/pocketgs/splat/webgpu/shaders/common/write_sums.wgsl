fn write_sums(slot: u32, sums: SplatSums) {
    let row = slot * SUM_WORDS;
    entry_gradients[row] = sums.exponent;
    entry_gradients[row + 1u] = sums.offset.x;
    entry_gradients[row + 2u] = sums.offset.y;
    entry_gradients[row + 3u] = sums.square.x;
    entry_gradients[row + 4u] = sums.square.y;
    entry_gradients[row + 5u] = sums.square.z;
    entry_gradients[row + 6u] = sums.colour.r;
    entry_gradients[row + 7u] = sums.colour.g;
    entry_gradients[row + 8u] = sums.colour.b;
}
