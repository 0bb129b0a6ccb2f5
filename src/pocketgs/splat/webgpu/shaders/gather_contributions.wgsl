// What each Gaussian adds to the image: its tiles' contributions together. `contributions` is all 0 before. One thread
// per Gaussian, in order of depth.
import view, ranks.slots, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> first_slots: array<u32>;
@group(0) @binding(3) var<storage, read> intersection_count: array<u32>;
@group(0) @binding(4) var<storage, read> contribution_rows: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> contributions: array<vec4f>;

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
    var sums = vec4f();
    for (var slot = reached.x; slot < reached.y; slot++) {
        let row = contribution_rows[slot];
        sums = vec4f(sums.xy + row.xy, max(sums.z, row.z), 0.0);
    }
    contributions[order[rank]] = sums;
}
