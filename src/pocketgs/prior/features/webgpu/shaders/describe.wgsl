// Descriptors of the chosen features of an octave: gradients around each, turned by its angle, summed by direction in
// 4 x 4 cells and interpolated between them (Lowe 2004, section 6). RootSIFT: square roots of shares of the sum
// (Arandjelovic and Zisserman, "Three things everyone should know to improve object retrieval", 2012).
//
// One workgroup per feature: PARTS threads per cell, each for every PARTS-th row of pixels that the cell can touch.
import scale_space, scale_space.gradient, feature, workgroups

@group(0) @binding(0) var<uniform> image: Image;
@group(0) @binding(1) var<storage, read> scale_space: array<f32>;
@group(0) @binding(2) var<storage, read> features: array<Feature>;
@group(0) @binding(3) var<storage, read_write> descriptors: array<f32>;

const SIZE: u32 = CELLS * CELLS * BINS;
const PARTS: u32 = SIZE / (CELLS * CELLS);

var<workgroup> shares: array<f32, SIZE * PARTS>;
var<workgroup> numbers: array<f32, SIZE>;

// The sums of one cell over its rows first, first + PARTS, ...
fn gathered(feature: Feature, cell: vec2f, first: u32) -> array<f32, BINS> {
    var sums: array<f32, BINS>;
    let width = i32(octave_width());
    let height = i32(octave_height());
    let middle = vec2i(round(vec2f(feature.x, feature.y)));
    let side = CELL_SIDE * feature.scale;
    let cosine = cos(feature.angle) / side;
    let sine = sin(feature.angle) / side;
    // The cell's middle, from the feature's: the rotation of its place in cells.
    let from_middle = cell + 0.5 - 0.5 * f32(CELLS);
    let centre = vec2f(
        from_middle.x * cosine + from_middle.y * sine,
        from_middle.y * cosine - from_middle.x * sine,
    ) * (side * side);
    // What a cell takes part in is a square of two cells' side.
    let reach = sqrt(2.0) * side;
    let top = vec2i(floor(centre - reach));
    let bottom = vec2i(ceil(centre + reach));
    for (var down = top.y + i32(first); down <= bottom.y; down += i32(PARTS)) {
        let row = middle.y + down;
        if (row <= 0 || row >= height - 1) {
            continue;
        }
        for (var across = top.x; across <= bottom.x; across++) {
            let column = middle.x + across;
            let turned = vec2f(
                f32(across) * cosine - f32(down) * sine,
                f32(across) * sine + f32(down) * cosine,
            );
            let near = 1.0 - abs(turned - from_middle);
            if (column <= 0 || column >= width - 1 || near.x <= 0.0 || near.y <= 0.0) {
                continue;
            }
            let found = gradient(u32(feature.layer) * octave_pixels() + u32(row * width + column));
            let weight = exp(-dot(turned, turned) / (0.5 * f32(CELLS * CELLS))) * found.y * near.x * near.y;
            let bin = (found.x - feature.angle) * (f32(BINS) / TURN);
            let below = floor(bin);
            let lower = u32(i32(below) + i32(BINS)) % BINS;
            sums[lower] += weight * (1.0 - (bin - below));
            sums[(lower + 1u) % BINS] += weight * (bin - below);
        }
    }
    return sums;
}

// The sum of `numbers`; every thread of the workgroup must call it.
fn total(thread: u32) -> f32 {
    workgroupBarrier();
    shares[thread] = numbers[thread];
    for (var reach = SIZE / 2u; reach > 0u; reach = reach / 2u) {
        workgroupBarrier();
        if (thread < reach) {
            shares[thread] += shares[thread + reach];
        }
    }
    workgroupBarrier();
    return shares[0];
}

@compute @workgroup_size(SIZE)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = folded(workgroup);
    if (number >= image.chosen || features[number].octave != image.octave) {
        return;
    }
    let cell = thread / PARTS;
    let sums = gathered(features[number], vec2f(vec2u(cell % CELLS, cell / CELLS)), thread % PARTS);
    for (var bin = 0u; bin < BINS; bin++) {
        shares[(cell * BINS + bin) * PARTS + thread % PARTS] = sums[bin];
    }
    workgroupBarrier();
    var sum = 0.0;
    for (var part = 0u; part < PARTS; part++) {
        sum += shares[thread * PARTS + part];
    }
    numbers[thread] = sum * sum;
    // Large gradients are cut, so that light that is not linear changes less; then rounded as OpenCV does.
    let cut = min(sum, MOST_SHARE * sqrt(total(thread)));
    numbers[thread] = cut * cut;
    let whole = min(round(cut * DESCRIPTOR_LENGTH / max(sqrt(total(thread)), 1e-7)), 255.0);
    numbers[thread] = whole;
    descriptors[number * SIZE + thread] = sqrt(whole / max(total(thread), 1e-9));
}
