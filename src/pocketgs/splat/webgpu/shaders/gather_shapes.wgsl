// What the gradients of each splat's opacity and conic follow from: the sums of v and of v (dx², dx dy, dy²) over its
// pixels. `shape_gradients` is all 0 before. One thread per splat, in order of depth.
import view, ranks.slots, channel_rows.gather, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> first_slots: array<u32>;
@group(0) @binding(3) var<storage, read> intersection_count: array<u32>;
@group(0) @binding(4) var<storage, read> gradient_rows: array<f32>;
@group(0) @binding(5) var<storage, read_write> shape_gradients: array<vec4f>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = folded(workgroup) * THREADS + thread;
    let reached = slots_at(rank);
    if (reached.x == reached.y) {
        return;
    }
    let i = order[rank];
    let sums = gather(i, reached.x, reached.y);
    shape_gradients[i] = vec4f(sums.exponent, sums.square);
}
