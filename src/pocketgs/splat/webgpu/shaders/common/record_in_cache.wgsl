// The forward pass's side of the replay cache.
import replay_layout, replay_words

@group(0) @binding(7) var<storage, read_write> replay_cache: array<u32>;

fn remember(pixel: u32, contribution: u32, entry: u32, alpha: f32, colour: vec3f) {
    if (contribution < view.replay_depth) {
        let place = record_place(cache_place(pixel), contribution);
        let words = pack_record(entry, alpha, colour);
        for (var w = 0u; w < RECORD_WORDS; w++) {
            replay_cache[place + w] = words[w];
        }
    }
}

fn remember_count(pixel: u32, contributions: u32) {
    replay_cache[cache_place(pixel)] = contributions;
}
