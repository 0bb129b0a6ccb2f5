// How many pixels with confidence lie around each pixel in its row. One thread per pixel.
import comparison, comparison.window, mirrored, workgroups

@group(0) @binding(0) var<uniform> comparison: Comparison;
@group(0) @binding(1) var<storage, read> confidences: array<f32>;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;

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
    let row_start = pixel - column;
    var count = 0u;
    for (var i = -REACH; i <= REACH; i++) {
        let confidence = confidences[row_start + mirrored_with_ends(i32(column) + i, i32(comparison.width))];
        count += select(0u, 1u, confidence > 0.0);
    }
    counts[pixel] = count;
}
