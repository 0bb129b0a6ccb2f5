// Compare every depth of a view with the depth maps of the others: how many agree, how many see through the point to
// something behind it, and the smallest footprint of a pixel there. A depth that hardly any view confirms
// counts as contradicted once more where most of those around are different. One thread per pixel.
import comparison, comparison.votes, workgroups

@group(0) @binding(0) var<uniform> comparison: Comparison;
@group(0) @binding(1) var<storage, read> maps: array<f32>;
// For each view: rows of the transform from this view's camera axes to its own; focal lengths and principal point;
// width, height, the step of the coarser of the two sweeps, and the depth up to which its agreement counts.
@group(0) @binding(2) var<storage, read> others: array<vec4f>;
// Agreeing views in the lower half of a word, contradicting ones in the upper.
@group(0) @binding(3) var<storage, read_write> votes: array<u32>;
@group(0) @binding(4) var<storage, read_write> footprints: array<f32>;

const RECORD: u32 = 5u;

fn depth_at(view: u32, column: u32, row: u32) -> f32 {
    return maps[(view * comparison.image_height + row) * comparison.image_width + column];
}

// See `is_coherent` in `prior/depth/cpu/consistency.py`.
fn is_coherent(column: u32, row: u32, depth: f32) -> bool {
    let tolerance = COHERENT_STEPS * others[RECORD * comparison.view + 4u].z;
    let first = vec2u(max(column, AROUND) - AROUND, max(row, AROUND) - AROUND);
    let last = min(vec2u(column, row) + AROUND, vec2u(comparison.width, comparison.height) - 1u);
    var close = 0u;
    var known = 0u;
    for (var i = first.y; i <= last.y; i++) {
        for (var j = first.x; j <= last.x; j++) {
            let there = depth_at(comparison.view, j, i);
            known += u32(there > 0.0);
            close += u32(there > 0.0 && abs(there - depth) <= tolerance * depth * there);
        }
    }
    return 2u * close >= known;
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = folded(workgroup) * THREADS + thread;
    if (pixel >= comparison.width * comparison.height) {
        return;
    }
    let column = pixel % comparison.width;
    let row = pixel / comparison.width;
    let depth = depth_at(comparison.view, column, row);
    if (depth <= 0.0) {
        votes[pixel] = 0u;
        footprints[pixel] = 0.0;
        return;
    }
    let slopes = (vec2f(f32(column), f32(row)) + 0.5 - comparison.principal) / comparison.focal;
    let point = vec4f(slopes * depth, depth, 1.0);
    var footprint = depth / comparison.focal.x;
    var count = 0u;
    for (var other = 0u; other < comparison.views; other++) {
        let first = RECORD * other;
        let z = dot(others[first + 2u], point);
        if (other == comparison.view || z <= 0.0) {
            continue;
        }
        let lens = others[first + 3u];
        let extent = others[first + 4u];
        let found = lens.xy * vec2f(dot(others[first], point), dot(others[first + 1u], point)) / z + lens.zw;
        if (any(found < vec2f()) || any(found >= extent.xy)) {
            continue;
        }
        let theirs = depth_at(other, u32(found.x), u32(found.y));
        if (theirs <= 0.0) {
            continue;
        }
        let indistinct = clamp(extent.z * z, 0.5, 1.0) * extent.z * z * theirs;
        if (abs(z - theirs) < max(comparison.tolerance * z, indistinct)) {
            if (depth <= extent.w) {
                count += 1u;
                footprint = min(footprint, z / lens.x);
            }
        } else if (z < theirs) {
            count += 1u << 16u;
        }
    }
    if (agreeing_of(count) < CONFIRMED && !is_coherent(column, row, depth)) {
        count += 1u << 16u;
    }
    votes[pixel] = count;
    footprints[pixel] = footprint;
}
