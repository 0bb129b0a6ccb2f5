// Add up each block of `values`, taken in the order that `order` lists them in. One workgroup per block.
import scan.exclusive, workgroups

@group(0) @binding(0) var<storage, read> item_count: array<u32>;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
@group(0) @binding(3) var<storage, read_write> block_sums: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let length = item_count[0];
    let block = folded(workgroup);
    if (block * BLOCK >= length) {
        return;
    }
    var sum = 0u;
    for (var item = thread; item < BLOCK; item += THREADS) {
        let rank = block * BLOCK + item;
        if (rank < length) {
            sum += values[order[rank]];
        }
    }
    exclusive_scan(vec4u(sum), thread);
    if (thread == 0u) {
        block_sums[block] = scan_total().x;
    }
}
