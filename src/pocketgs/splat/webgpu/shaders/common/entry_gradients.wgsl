// What a splat's replay in one tile leaves behind, one row an entry at its slot: sums over the pixels of
// v = ∂L/∂(ln α) times 1, (dx, dy) and (dx², dx dy, dy²), and the gradient of its colour.
const SUM_WORDS: u32 = 9u;

struct SplatSums {
    exponent: f32,
    offset: vec2f,
    square: vec3f,
    colour: vec3f,
}
