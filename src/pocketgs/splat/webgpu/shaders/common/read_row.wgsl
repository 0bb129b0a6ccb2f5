// A row of `gradient_rows`, which the pass binds.
fn read_row(index: u32) -> SplatSums {
    let row = index * SUM_WORDS;
    return SplatSums(
        gradient_rows[row],
        vec2f(gradient_rows[row + 1u], gradient_rows[row + 2u]),
        vec3f(gradient_rows[row + 3u], gradient_rows[row + 4u], gradient_rows[row + 5u]),
        vec3f(gradient_rows[row + 6u], gradient_rows[row + 7u], gradient_rows[row + 8u]),
    );
}
