// Add up, for each block of Gaussians in order of depth, in how many tiles' lists they stand. One workgroup a block.
import view, folding, radix, scan

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> block_sums: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = folded(workgroup);
    if (block * BLOCK >= view.gaussians) {
        return;
    }
    var sum = 0u;
    for (var item = thread; item < BLOCK; item += THREADS) {
        let rank = block * BLOCK + item;
        if (rank < view.gaussians) {
            sum += tile_counts[order[rank]];
        }
    }
    exclusive_scan(vec4u(sum), thread);
    if (thread == 0u) {
        block_sums[block] = scan_total().x;
    }
}
