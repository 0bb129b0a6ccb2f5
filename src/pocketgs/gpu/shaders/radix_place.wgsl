// Where the keys of each digit and block go: running sums of the counts. Then the next digit's turn comes. One
// workgroup.
import radix, scan.in_place

@group(0) @binding(0) var<storage, read> item_count: array<u32>;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> digit: array<u32>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    scan_counts(DIGITS * ((item_count[0] + BLOCK - 1u) / BLOCK), thread);
    if (thread == 0u) {
        digit[PLACED] = digit[COUNTED];
        digit[COUNTED] += DIGIT_BITS;
    }
}
