// Turn counts into running sums, in place, each without itself. One workgroup walks over all of them.
import view, radix, lengths, scan

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> entry_count: array<u32>;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;

// How many counts there are for every block of the list.
override counts_per_block: u32 = 16u;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) thread: u32) {
    let blocks = (list_length(view, entry_count[0]) + BLOCK - 1u) / BLOCK;
    let length = counts_per_block * blocks;
    var carried = 0u;
    for (var start = 0u; start < length; start += BLOCK) {
        let first = start + thread * KEYS_PER_THREAD;
        var sum = 0u;
        for (var index = first; index < min(first + KEYS_PER_THREAD, length); index++) {
            sum += counts[index];
        }
        var running = carried + exclusive_scan(vec4u(sum), thread).x;
        for (var index = first; index < min(first + KEYS_PER_THREAD, length); index++) {
            let count = counts[index];
            counts[index] = running;
            running += count;
        }
        carried += scan_total().x;
    }
}
