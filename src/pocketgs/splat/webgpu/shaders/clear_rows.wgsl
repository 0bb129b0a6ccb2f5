// Set the rows of gradients of all intersections to 0. One thread per intersection.
import gradient_rows, workgroups

@group(0) @binding(0) var<storage, read> intersection_count: array<u32>;
@group(0) @binding(1) var<storage, read_write> gradient_rows: array<f32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let intersection = folded(workgroup) * THREADS + thread;
    if (intersection >= intersection_count[0]) {
        return;
    }
    for (var w = 0u; w < SUM_WORDS; w++) {
        gradient_rows[intersection * SUM_WORDS + w] = 0.0;
    }
}
