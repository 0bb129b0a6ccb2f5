// The replay cache: for every pixel the number of its contributions, and of the first of them a record each. A record
// holds the entry that contributed, its α, and the colour composited up to and with it: what lies behind, C_in of the
// PocketGS paper, is the pixel's final colour less that.
fn cache_place(pixel: u32) -> u32 {
    return pixel * (1u + RECORD_WORDS * view.replay_depth);
}

fn record_place(cache_place: u32, contribution: u32) -> u32 {
    return cache_place + 1u + contribution * RECORD_WORDS;
}
