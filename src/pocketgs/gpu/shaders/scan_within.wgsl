// Running sums of `values`, taken in the order that `order` lists them in: each without itself, and their total in the
// end. One workgroup per block.
import radix, scan.exclusive, workgroups

@group(0) @binding(0) var<storage, read> item_count: array<u32>;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
@group(0) @binding(3) var<storage, read> block_sums: array<u32>;
@group(0) @binding(4) var<storage, read_write> sums: array<u32>;

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
    let first = block * BLOCK + thread * KEYS_PER_THREAD;
    let end = min(first + KEYS_PER_THREAD, length);
    var sum = 0u;
    for (var rank = first; rank < end; rank++) {
        sum += values[order[rank]];
    }
    var running = block_sums[block] + exclusive_scan(vec4u(sum), thread).x;
    for (var rank = first; rank < end; rank++) {
        sums[rank] = running;
        running += values[order[rank]];
        if (rank == length - 1u) {
            sums[length] = running;
        }
    }
}
