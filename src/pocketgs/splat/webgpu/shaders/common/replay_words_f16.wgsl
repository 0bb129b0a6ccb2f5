// How a record of the replay cache is stored: colours in half precision, α in steps of 1/65535, since half precision
// would lose 1 - α where α is near 1. The entry comes first.
const RECORD_WORDS: u32 = 3u;

fn pack_record(entry: u32, alpha: f32, colour: vec3f) -> array<u32, RECORD_WORDS> {
    let alpha_red = pack2x16unorm(vec2f(alpha, 0.0)) | pack2x16float(vec2f(0.0, colour.r));
    return array<u32, RECORD_WORDS>(entry, alpha_red, pack2x16float(colour.gb));
}

fn record_alpha(words: array<u32, RECORD_WORDS>) -> f32 {
    return unpack2x16unorm(words[1]).x;
}

fn record_colour(words: array<u32, RECORD_WORDS>) -> vec3f {
    return vec3f(unpack2x16float(words[1]).y, unpack2x16float(words[2]));
}
