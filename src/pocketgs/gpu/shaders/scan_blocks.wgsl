// Where each block's part of the running sums begins: running sums of the blocks' sums. One workgroup.
import scan.in_place

@group(0) @binding(0) var<storage, read> item_count: array<u32>;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    scan_counts((item_count[0] + BLOCK - 1u) / BLOCK, thread);
}
