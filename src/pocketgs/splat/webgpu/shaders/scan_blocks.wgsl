// Turn counts into running sums, in place, each without itself. One workgroup walks over all of them.
//
// Sums that 32 bits do not hold stay at FULL, more than there is ever room for: the upper halves of the counts are summed
// beside them, and show in time when the sums come near.
import view, radix, lengths, scan

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> entry_count: array<u32>;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;

// How many counts there are for every block of the list.
override counts_per_block: u32 = 16u;

const FULL: u32 = 0x7fff0000u;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    let blocks = (list_length(view, entry_count[0]) + BLOCK - 1u) / BLOCK;
    let length = counts_per_block * blocks;
    var carried = vec4u();
    for (var start = 0u; start < length; start += BLOCK) {
        let first = start + thread * KEYS_PER_THREAD;
        var sum = 0u;
        for (var index = first; index < min(first + KEYS_PER_THREAD, length); index++) {
            sum += counts[index];
        }
        let before = carried + exclusive_scan(vec4u(sum, sum >> 16u, 0u, 0u), thread);
        var running = select(before.x, FULL, before.y >= FULL >> 16u);
        for (var index = first; index < min(first + KEYS_PER_THREAD, length); index++) {
            let count = counts[index];
            counts[index] = running;
            running = min(running + count, FULL);
        }
        carried += scan_total();
    }
}
