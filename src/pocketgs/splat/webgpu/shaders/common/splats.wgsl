// A projected Gaussian. Its exponent is held to base 2, with the opacity inside:
// log2 α(dx, dy) = log2_opacity + exponents.x dx² + exponents.y dx dy + exponents.z dy².
struct Splat {
    mean: vec2f,
    depth: f32,
    log2_opacity: f32,
    exponents: vec3f,
    // How much it counts in an image that is not sorted; 1 in others.
    weight: f32,
    colour: vec3f,
}

fn exponent_at(splat: Splat, offset: vec2f) -> f32 {
    let e = splat.exponents;
    return splat.log2_opacity + e.x * offset.x * offset.x + offset.y * (e.y * offset.x + e.z * offset.y);
}

// Q = Σ'⁻¹: the exponent of a Gaussian, to base e, is -½ dᵀ Q d.
fn inverse_covariance(splat: Splat) -> mat2x2f {
    let e = splat.exponents / LOG2_E;
    return mat2x2f(-2.0 * e.x, -e.y, -e.y, -2.0 * e.z);
}

section words_f32
// How a splat is stored: in full precision.
const SPLAT_WORDS: u32 = SPLAT_WORDS_F32;

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
        1.0,
        vec3f(bitcast<f32>(words[7]), bitcast<f32>(words[8]), bitcast<f32>(words[9])),
    );
}

section words_weighted
// How a splat with a weight is stored: in full precision.
const SPLAT_WORDS: u32 = SPLAT_WORDS_WEIGHTED;

fn pack_splat(splat: Splat) -> array<u32, SPLAT_WORDS> {
    let e = bitcast<vec3u>(splat.exponents);
    let c = bitcast<vec3u>(splat.colour);
    return array<u32, SPLAT_WORDS>(
        bitcast<u32>(splat.mean.x),
        bitcast<u32>(splat.mean.y),
        bitcast<u32>(splat.depth),
        bitcast<u32>(splat.log2_opacity),
        e.x,
        e.y,
        e.z,
        c.r,
        c.g,
        c.b,
        bitcast<u32>(splat.weight),
    );
}

fn unpack_splat(words: array<u32, SPLAT_WORDS>) -> Splat {
    return Splat(
        bitcast<vec2f>(vec2u(words[0], words[1])),
        bitcast<f32>(words[2]),
        bitcast<f32>(words[3]),
        bitcast<vec3f>(vec3u(words[4], words[5], words[6])),
        bitcast<f32>(words[10]),
        bitcast<vec3f>(vec3u(words[7], words[8], words[9])),
    );
}

section words_f16
// How a splat is stored: centre and depth in full precision, the rest in half.
//
// The falloff is stored as three numbers of the order of one over pixels, which half precision holds well where their
// squares would vanish: log2 α = log2_opacity - (a dx + b dy)² - (c dy)².
const SPLAT_WORDS: u32 = SPLAT_WORDS_F16;
// The smallest normal number of half precision: splats larger than some 14,000 pixels are stored as if of that size.
const MIN_FACTOR: f32 = 6.103515625e-5;

fn pack_splat(splat: Splat) -> array<u32, SPLAT_WORDS> {
    let e = -splat.exponents;
    let a = max(sqrt(e.x), MIN_FACTOR);
    let b = 0.5 * e.y / a;
    let c = max(sqrt(max(e.z - b * b, 0.0)), MIN_FACTOR);
    return array<u32, SPLAT_WORDS>(
        bitcast<u32>(splat.mean.x),
        bitcast<u32>(splat.mean.y),
        bitcast<u32>(splat.depth),
        pack2x16float(vec2f(a, b)),
        pack2x16float(vec2f(c, splat.log2_opacity)),
        pack2x16float(splat.colour.rg),
        pack2x16float(vec2f(splat.colour.b, 0.0)),
    );
}

fn unpack_splat(words: array<u32, SPLAT_WORDS>) -> Splat {
    let ab = unpack2x16float(words[3]);
    let c_opacity = unpack2x16float(words[4]);
    let c = c_opacity.x;
    return Splat(
        vec2f(bitcast<f32>(words[0]), bitcast<f32>(words[1])),
        bitcast<f32>(words[2]),
        c_opacity.y,
        -vec3f(ab.x * ab.x, 2.0 * ab.x * ab.y, ab.y * ab.y + c * c),
        1.0,
        vec3f(unpack2x16float(words[5]), unpack2x16float(words[6]).x),
    );
}

section read
import splats.words
// Splat i of `splats`, which the pass binds.
fn read_splat(i: u32) -> Splat {
    var words: array<u32, SPLAT_WORDS>;
    for (var w = 0u; w < SPLAT_WORDS; w++) {
        words[w] = splats[i * SPLAT_WORDS + w];
    }
    return unpack_splat(words);
}
