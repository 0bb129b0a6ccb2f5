// Replay from what the forward pass kept; contributions beyond the cache's depth are recomputed.
import replay_layout, replay_words

@group(0) @binding(8) var<storage, read> replay_cache: array<u32>;

// Of each pixel of the tile: where its part of the cache begins, how many contributions it had, how many of those have
// been replayed, and C · ∂L/∂C.
var<workgroup> cache_places: array<u32, TILE_PIXELS>;
var<workgroup> contributions: array<u32, TILE_PIXELS>;
var<workgroup> replayed: array<u32, TILE_PIXELS>;
var<workgroup> totals: array<f32, TILE_PIXELS>;

fn begin_replay(pixel: u32, image_index: u32) {
    let place = cache_place(image_index);
    cache_places[pixel] = place;
    contributions[pixel] = replay_cache[place];
    replayed[pixel] = 0u;
    totals[pixel] = dot(image[image_index].rgb, d_image[image_index].rgb);
}

fn replay(splat: Splat, entry: u32, pixel: u32, offset: vec2f, transmittance: f32, d_colour: vec3f) -> Contribution {
    let next = replayed[pixel];
    if (transmittance == 0.0 || next == contributions[pixel]) {
        return Contribution(0.0, 0.0);
    }
    if (next >= view.replay_depth) {
        let alpha = alpha_at(exponent_at(splat, offset), transmittance);
        replayed[pixel] += select(0u, 1u, alpha > 0.0);
        return Contribution(alpha, behind[pixel] - alpha * transmittance * dot(splat.colour, d_colour));
    }
    let place = record_place(cache_places[pixel], next);
    if (replay_cache[place] != entry) {
        return Contribution(0.0, 0.0);
    }
    replayed[pixel] = next + 1u;
    var words: array<u32, RECORD_WORDS>;
    for (var w = 0u; w < RECORD_WORDS; w++) {
        words[w] = replay_cache[place + w];
    }
    return Contribution(record_alpha(words), totals[pixel] - dot(record_colour(words), d_colour));
}
