// How a record of the replay cache is stored: in full precision. The entry comes first.
const RECORD_WORDS: u32 = 5u;

fn pack_record(entry: u32, alpha: f32, colour: vec3f) -> array<u32, RECORD_WORDS> {
    let c = bitcast<vec3u>(colour);
    return array<u32, RECORD_WORDS>(entry, bitcast<u32>(alpha), c.r, c.g, c.b);
}

fn record_alpha(words: array<u32, RECORD_WORDS>) -> f32 {
    return bitcast<f32>(words[1]);
}

fn record_colour(words: array<u32, RECORD_WORDS>) -> vec3f {
    return bitcast<vec3f>(vec3u(words[2], words[3], words[4]));
}
