// Splat i of `splats`, which the pass binds.
fn read_splat(i: u32) -> Splat {
    var words: array<u32, SPLAT_WORDS>;
    for (var w = 0u; w < SPLAT_WORDS; w++) {
        words[w] = splats[i * SPLAT_WORDS + w];
    }
    return unpack_splat(words);
}
