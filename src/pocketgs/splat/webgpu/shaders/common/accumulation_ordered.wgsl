// Every entry has a row of its own, and a splat's rows lie side by side: they are added up later, always in the same
// order, so that a step gives the same bits every time.
alias GradientWord = f32;

fn accumulate(slot: u32, splat: u32, sums: SplatSums) {
    let words = sum_words(sums);
    for (var w = 0u; w < SUM_WORDS; w++) {
        gradient_rows[slot * SUM_WORDS + w] = words[w];
    }
}
