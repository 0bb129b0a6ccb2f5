import gradient_rows
// What a splat's replay leaves behind in one tile where any number of channels is composited: the sums of `SplatSums`
// but the colour; the summed magnitudes of the gradient with respect to its centre; and the gradient of each channel.
const ABSOLUTE_WORD: u32 = 6u;

fn channel_row(slot: u32) -> u32 {
    return slot * (SHAPE_WORDS + 3u * view.channel_groups);
}

section gather
// The sum of a splat's rows from `gradient_rows`, which the pass binds. The colour is the first group of channels.
fn gather_word(first_slot: u32, end_slot: u32, word: u32) -> f32 {
    var sum = 0.0;
    for (var slot = first_slot; slot < end_slot; slot++) {
        sum += gradient_rows[channel_row(slot) + word];
    }
    return sum;
}

fn gather3(first_slot: u32, end_slot: u32, word: u32) -> vec3f {
    return vec3f(
        gather_word(first_slot, end_slot, word),
        gather_word(first_slot, end_slot, word + 1u),
        gather_word(first_slot, end_slot, word + 2u),
    );
}

fn gather(splat: u32, first_slot: u32, end_slot: u32) -> SplatSums {
    let begin = gather3(first_slot, end_slot, 0u);
    let square = gather3(first_slot, end_slot, 3u);
    return SplatSums(begin.x, begin.yz, square, gather3(first_slot, end_slot, SHAPE_WORDS));
}
