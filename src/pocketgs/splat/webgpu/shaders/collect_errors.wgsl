// Add to each Gaussian its part of a view's error: Σ over pixels of α T |rendered - photograph|, which the backward
// pass has left in the place of the red gradient. Nothing happens while the run is halted. One thread per Gaussian, in
// order of depth.
import view, ranks.slots, statistics, gradient_rows.gather, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> first_slots: array<u32>;
@group(0) @binding(3) var<storage, read> gradient_rows: array<f32>;
@group(0) @binding(4) var<storage, read> intersection_count: array<u32>;
@group(0) @binding(5) var<storage, read_write> statistics: array<f32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = folded(workgroup) * THREADS + thread;
    let reached = slots_at(rank);
    if (reached.x < reached.y) {
        let i = order[rank];
        statistics[ERROR * view.gaussians + i] += gather(i, reached.x, reached.y).colour.r;
    }
}
