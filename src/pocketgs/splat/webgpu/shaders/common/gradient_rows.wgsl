// What a splat's replay in one tile leaves behind: sums over the pixels of
// v = ∂L/∂(ln α) times 1, (dx, dy) and (dx², dx dy, dy²), and the gradient of its colour.
const SUM_WORDS: u32 = 9u;

struct SplatSums {
    exponent: f32,
    offset: vec2f,
    square: vec3f,
    colour: vec3f,
}

fn sum_words(sums: SplatSums) -> array<f32, SUM_WORDS> {
    return array<f32, SUM_WORDS>(
        sums.exponent,
        sums.offset.x,
        sums.offset.y,
        sums.square.x,
        sums.square.y,
        sums.square.z,
        sums.colour.r,
        sums.colour.g,
        sums.colour.b,
    );
}
