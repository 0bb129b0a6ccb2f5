// How the backward pass comes by what the forward pass computed: it computes it again, or the forward pass keeps it in
// a cache.

section record_nothing
// Replay by recomputation: the forward pass keeps nothing.
fn remember(pixel: u32, contribution: u32, intersection: u32, alpha: f32, colour: vec3f) {
}

fn remember_count(pixel: u32, contributions: u32) {
}

section by_recomputing
// Replay by recomputation: α again from the exponent.
fn begin_replay(pixel: u32, image_index: u32) {
}

fn replay(
    splat: Splat, intersection: u32, pixel: u32, offset: vec2f, transmittance: f32, d_colour: vec3f,
) -> Contribution {
    let alpha = alpha_at(exponent_at(splat, offset), transmittance);
    return Contribution(alpha, behind[pixel] - alpha * transmittance * dot(splat.colour, d_colour));
}

section cache
import replay.words
// The replay cache: for every pixel the number of its contributions, and of the first of them a record each. A record
// holds the intersection that contributed, its α, and the colour composited up to and with it: what lies behind, C_in
// of the PocketGS paper, is the pixel's final colour less that.
fn cache_place(pixel: u32) -> u32 {
    return pixel * (1u + RECORD_WORDS * view.replay_depth);
}

fn record_place(cache_place: u32, contribution: u32) -> u32 {
    return cache_place + 1u + contribution * RECORD_WORDS;
}

section words_f32
// How a record of the replay cache is stored: in full precision. The intersection comes first.
const RECORD_WORDS: u32 = RECORD_WORDS_F32;

fn pack_record(intersection: u32, alpha: f32, colour: vec3f) -> array<u32, RECORD_WORDS> {
    let c = bitcast<vec3u>(colour);
    return array<u32, RECORD_WORDS>(intersection, bitcast<u32>(alpha), c.r, c.g, c.b);
}

fn record_alpha(words: array<u32, RECORD_WORDS>) -> f32 {
    return bitcast<f32>(words[1]);
}

fn record_colour(words: array<u32, RECORD_WORDS>) -> vec3f {
    return bitcast<vec3f>(vec3u(words[2], words[3], words[4]));
}

section words_f16
// How a record of the replay cache is stored: colours in half precision, α in steps of 1/65535, since half precision
// would lose 1 - α where α is near 1. The intersection comes first.
const RECORD_WORDS: u32 = RECORD_WORDS_F16;

fn pack_record(intersection: u32, alpha: f32, colour: vec3f) -> array<u32, RECORD_WORDS> {
    let alpha_red = pack2x16unorm(vec2f(alpha, 0.0)) | pack2x16float(vec2f(0.0, colour.r));
    return array<u32, RECORD_WORDS>(intersection, alpha_red, pack2x16float(colour.gb));
}

fn record_alpha(words: array<u32, RECORD_WORDS>) -> f32 {
    return unpack2x16unorm(words[1]).x;
}

fn record_colour(words: array<u32, RECORD_WORDS>) -> vec3f {
    return vec3f(unpack2x16float(words[1]).y, unpack2x16float(words[2]));
}

section record_in_cache
import replay.cache
// The forward pass's side of the replay cache.

@group(0) @binding(7) var<storage, read_write> replay_cache: array<u32>;

fn remember(pixel: u32, contribution: u32, intersection: u32, alpha: f32, colour: vec3f) {
    if (contribution < view.replay_depth) {
        let place = record_place(cache_place(pixel), contribution);
        let words = pack_record(intersection, alpha, colour);
        for (var w = 0u; w < RECORD_WORDS; w++) {
            replay_cache[place + w] = words[w];
        }
    }
}

fn remember_count(pixel: u32, contributions: u32) {
    replay_cache[cache_place(pixel)] = contributions;
}

section from_cache
import replay.cache
// Replay from what the forward pass kept; contributions beyond the cache's depth are recomputed.

@group(0) @binding(8) var<storage, read> replay_cache: array<u32>;

// Of each pixel of the tile: where its part of the cache begins, how many contributions it had, how many of those have
// been replayed, and H before the first.
var<workgroup> cache_places: array<u32, TILE_PIXELS>;
var<workgroup> contributions: array<u32, TILE_PIXELS>;
var<workgroup> replayed: array<u32, TILE_PIXELS>;
var<workgroup> totals: array<f32, TILE_PIXELS>;

fn begin_replay(pixel: u32, image_index: u32) {
    let place = cache_place(image_index);
    cache_places[pixel] = place;
    contributions[pixel] = replay_cache[place];
    replayed[pixel] = 0u;
    totals[pixel] = first_behind(image[image_index], d_image[image_index]);
}

fn replay(
    splat: Splat, intersection: u32, pixel: u32, offset: vec2f, transmittance: f32, d_colour: vec3f,
) -> Contribution {
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
    if (replay_cache[place] != intersection) {
        return Contribution(0.0, 0.0);
    }
    replayed[pixel] = next + 1u;
    var words: array<u32, RECORD_WORDS>;
    for (var w = 0u; w < RECORD_WORDS; w++) {
        words[w] = replay_cache[place + w];
    }
    return Contribution(record_alpha(words), totals[pixel] - dot(record_colour(words), d_colour));
}
