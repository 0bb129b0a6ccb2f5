// Every splat has one row, to which the tiles add in whatever order they come. It takes less memory, needs atomic
// addition of floats, and the last bits differ from run to run.
alias GradientWord = atomic<f32>;

fn accumulate(slot: u32, splat: u32, sums: SplatSums) {
    let words = sum_words(sums);
    for (var w = 0u; w < SUM_WORDS; w++) {
        atomicAdd(&gradient_rows[splat * SUM_WORDS + w], words[w]);
    }
}
