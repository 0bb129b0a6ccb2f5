// What a splat's replay in one tile leaves behind: sums over the pixels of
// v = ∂L/∂(ln α) times 1, (dx, dy) and (dx², dx dy, dy²), and the gradient of its colour.

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

section add_ordered
// Every intersection has a row of its own, and a splat's rows lie side by side: they are added up later, always in
// the same order, so that a step gives the same bits every time.
alias GradientWord = f32;

fn accumulate(slot: u32, splat: u32, sums: SplatSums) {
    let words = sum_words(sums);
    for (var w = 0u; w < SUM_WORDS; w++) {
        gradient_rows[slot * SUM_WORDS + w] = words[w];
    }
}

section add_atomic
// Every splat has one row, to which the tiles add in whatever order they come. It takes less memory, needs atomic
// addition of floats, and the last bits differ from run to run.
alias GradientWord = atomic<f32>;

fn accumulate(slot: u32, splat: u32, sums: SplatSums) {
    let words = sum_words(sums);
    for (var w = 0u; w < SUM_WORDS; w++) {
        atomicAdd(&gradient_rows[splat * SUM_WORDS + w], words[w]);
    }
}

section read
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

section gather_ordered
import gradient_rows.read
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

section gather_atomic
import gradient_rows.read
// A splat's row holds the sum already.
fn gather(splat: u32, first_slot: u32, end_slot: u32) -> SplatSums {
    return read_row(splat);
}
