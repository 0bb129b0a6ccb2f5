// Where each Gaussian's entries begin, in order of depth: the running sum of the counts. One workgroup a block.
import view, folding, radix, scan

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(3) var<storage, read> block_sums: array<u32>;
@group(0) @binding(4) var<storage, read_write> first_slots: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = folded(workgroup);
    if (block * BLOCK >= view.gaussians) {
        return;
    }
    let first = block * BLOCK + thread * KEYS_PER_THREAD;
    let end = min(first + KEYS_PER_THREAD, view.gaussians);
    var sum = 0u;
    for (var rank = first; rank < end; rank++) {
        sum += tile_counts[order[rank]];
    }
    var running = block_sums[block] + exclusive_scan(vec4u(sum), thread).x;
    for (var rank = first; rank < end; rank++) {
        first_slots[rank] = running;
        running += tile_counts[order[rank]];
        if (rank == view.gaussians - 1u) {
            first_slots[view.gaussians] = running;
        }
    }
}
