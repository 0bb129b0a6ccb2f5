// Give little confidence to depths in holes, where few others have any, if no view contradicts them and they are cheaper
// than others by a margin. One thread per pixel.
import comparison, comparison.votes, comparison.window, mirrored, workgroups

@group(0) @binding(0) var<uniform> comparison: Comparison;
@group(0) @binding(1) var<storage, read> maps: array<f32>;
@group(0) @binding(2) var<storage, read> votes: array<u32>;
@group(0) @binding(3) var<storage, read> margins: array<f32>;
// Of pixels with confidence, around each pixel in its row.
@group(0) @binding(4) var<storage, read> counts: array<u32>;
@group(0) @binding(5) var<storage, read_write> confidences: array<f32>;

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
    var count = 0u;
    for (var i = -REACH; i <= REACH; i++) {
        count += counts[mirrored_with_ends(i32(row) + i, i32(comparison.height)) * comparison.width + column];
    }
    let is_hole = f32(count) < HOLE_SHARE * f32(HOLE * HOLE);
    let depth = maps[(comparison.view * comparison.image_height + row) * comparison.image_width + column];
    let is_uncontradicted = contradicting_of(votes[pixel]) == 0u;
    if (is_hole && depth > 0.0 && is_uncontradicted && margins[pixel] >= FILLER_MARGIN) {
        confidences[pixel] = FILLER_CONFIDENCE;
    }
}
