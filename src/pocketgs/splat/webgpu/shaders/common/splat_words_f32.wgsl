// How a splat is stored: in full precision.
const SPLAT_WORDS: u32 = 10u;

fn pack_splat(splat: Splat) -> array<u32, SPLAT_WORDS> {
    return array<u32, SPLAT_WORDS>(
        bitcast<u32>(splat.mean.x),
        bitcast<u32>(splat.mean.y),
        bitcast<u32>(splat.depth),
        bitcast<u32>(splat.log2_opacity),
        bitcast<u32>(splat.exponents.x),
        bitcast<u32>(splat.exponents.y),
        bitcast<u32>(splat.exponents.z),
        bitcast<u32>(splat.colour.r),
        bitcast<u32>(splat.colour.g),
        bitcast<u32>(splat.colour.b),
    );
}

fn unpack_splat(words: array<u32, SPLAT_WORDS>) -> Splat {
    return Splat(
        vec2f(bitcast<f32>(words[0]), bitcast<f32>(words[1])),
        bitcast<f32>(words[2]),
        bitcast<f32>(words[3]),
        vec3f(bitcast<f32>(words[4]), bitcast<f32>(words[5]), bitcast<f32>(words[6])),
        vec3f(bitcast<f32>(words[7]), bitcast<f32>(words[8]), bitcast<f32>(words[9])),
    );
}
