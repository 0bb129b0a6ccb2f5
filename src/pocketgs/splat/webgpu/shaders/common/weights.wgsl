// How much a splat counts in an image that is not sorted: `pocketgs/sort_free/forms.py` has the same rules by the same
// names, and says where they come from.

section none
// Sorted splats have no weights.
fn weight_of(gaussian: Gaussian, i: u32) -> f32 {
    return 1.0;
}

fn note_weight(splat: Splat) {
}

section shared
// What the weights of all Gaussians are made with; numbers that a form lacks are 0.
struct Weighting {
    // Length that distances and sizes are measured in, in scene units.
    unit: f32,
    sigma: f32,
    beta: f32,
    // The background's weight.
    background: f32,
    // Spherical-harmonics coefficients of each v.
    view_coefficients: u32,
}

// Exponents are cut here.
const LARGEST_EXPONENT: f32 = 40.0;

section seen
import weights.shared, view, gaussians, spherical_harmonics, finite
// What the camera sees of a Gaussian; `views` lies column by column, as the other parameters do.
@group(0) @binding(8) var<uniform> weighting: Weighting;
@group(0) @binding(9) var<storage, read> views: array<f32>;

fn distance_of(gaussian: Gaussian) -> f32 {
    return length(gaussian.mean - view.centre.xyz) / weighting.unit;
}

fn view_of(gaussian: Gaussian, i: u32) -> f32 {
    let direction = normalize(gaussian.mean - view.centre.xyz);
    var v = 0.0;
    for (var k = 0u; k < weighting.view_coefficients; k++) {
        v += harmonic(k, direction) * views[k * view.gaussians + i];
    }
    return v;
}

// v cut to 0 where negative. What is not finite stays, and is not drawn.
fn positive_view_of(gaussian: Gaussian, i: u32) -> f32 {
    let v = view_of(gaussian, i);
    return select(v, max(v, 0.0), is_finite(v));
}

section complete
import splats
// Weights that need nothing of other splats.
fn note_weight(splat: Splat) {
}

section direct
import weights.seen, weights.complete
fn weight_of(gaussian: Gaussian, i: u32) -> f32 {
    return 1.0;
}

section exponential
import weights.seen, weights.complete
fn weight_of(gaussian: Gaussian, i: u32) -> f32 {
    return exp(-weighting.sigma * pow(distance_of(gaussian), weighting.beta));
}

section lc
import weights.seen, weights.complete
fn weight_of(gaussian: Gaussian, i: u32) -> f32 {
    return max(1.0 - distance_of(gaussian) / weighting.sigma, 0.0) * positive_view_of(gaussian, i);
}

section mobile
import weights.seen, weights.complete
fn weight_of(gaussian: Gaussian, i: u32) -> f32 {
    let d = distance_of(gaussian);
    let phi = positive_view_of(gaussian, i);
    let scale = gaussian.log_scale;
    let size = exp(max(scale.x, max(scale.y, scale.z))) / weighting.unit;
    return phi * phi + phi / (d * d) + exp(min(size / d, LARGEST_EXPONENT));
}

section exponents
// Words of `largest_exponents`, all 0 before: the largest exponent of the splats whose centres are in the image, and of
// all that are drawn, as numbers that sort as they do. None is 0.
const IN_IMAGE: u32 = 0u;
const DRAWN: u32 = 1u;

fn key_of(exponent: f32) -> u32 {
    let bits = bitcast<u32>(exponent);
    return select(bits | 0x80000000u, ~bits, (bits & 0x80000000u) != 0u);
}

fn exponent_of(key: u32) -> f32 {
    return bitcast<f32>(select(~key, key & 0x7fffffffu, (key & 0x80000000u) != 0u));
}

section visibility
import weights.seen, weights.exponents, splats
// The logarithm of the weight. A common factor of all weights cancels, so the largest is found first.
@group(0) @binding(10) var<storage, read_write> largest_exponents: array<atomic<u32>, 2>;

fn weight_of(gaussian: Gaussian, i: u32) -> f32 {
    return view_of(gaussian, i) - weighting.sigma * log(distance_of(gaussian));
}

fn note_weight(splat: Splat) {
    let key = key_of(splat.weight);
    note_key(DRAWN, key);
    // A splat beside the image does not count: next to its weight, all others might fall below the cut.
    if (all(splat.mean >= vec2f()) && all(splat.mean <= vec2f(f32(view.width), f32(view.height)))) {
        note_key(IN_IMAGE, key);
    }
}

fn note_key(word: u32, key: u32) {
    // Most are smaller: to look first spares the wait for the others.
    if (key > atomicLoad(&largest_exponents[word])) {
        atomicMax(&largest_exponents[word], key);
    }
}

section as_made
// The weights that `weight_of` has made are those that splats are added up with.
fn finished_weight(weight: f32) -> f32 {
    return weight;
}

section by_largest
import weights.shared, weights.exponents
// `weight_of` has made exponents: they are taken relative to the largest.
@group(0) @binding(7) var<storage, read> largest_exponents: array<u32, 2>;

fn finished_weight(exponent: f32) -> f32 {
    let found = largest_exponents[IN_IMAGE];
    let largest = exponent_of(select(found, largest_exponents[DRAWN], found == 0u));
    return exp(clamp(exponent - largest, -LARGEST_EXPONENT, LARGEST_EXPONENT));
}
