// Turn `counts`, which the pass binds, into running sums, in place, each without itself; one workgroup walks over all.
//
// Sums that 32 bits do not hold stay at FULL, more than there is ever room for: the upper halves of the counts are summed
// beside them, and show in time when the sums come near.
import radix, scan

const FULL: u32 = 0x7fff0000u;

fn scan_counts(length: u32, thread: u32) {
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
