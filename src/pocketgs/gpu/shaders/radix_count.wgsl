// Count the digits of each block of keys. One workgroup per block.
import radix, workgroups

@group(0) @binding(0) var<storage, read> item_count: array<u32>;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> digit_counts: array<u32>;
@group(0) @binding(3) var<storage, read> digit: array<u32>;

var<workgroup> counts: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let length = item_count[0];
    let blocks = (length + BLOCK - 1u) / BLOCK;
    let block = folded(workgroup);
    if (block >= blocks) {
        return;
    }
    // WGSL has workgroup memory begin at 0, but not every driver keeps to it.
    if (thread < DIGITS) {
        atomicStore(&counts[thread], 0u);
    }
    workgroupBarrier();
    for (var item = thread; item < BLOCK; item += THREADS) {
        let index = block * BLOCK + item;
        if (index < length) {
            atomicAdd(&counts[digit_of(keys[index], digit[COUNTED])], 1u);
        }
    }
    workgroupBarrier();
    // Digit after digit, so that a running sum over all counts gives every block's place for every digit.
    if (thread < DIGITS) {
        digit_counts[thread * blocks + block] = atomicLoad(&counts[thread]);
    }
}
