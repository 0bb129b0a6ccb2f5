// Move each block's keys and values to their digits' places, equal digits in their order. One workgroup per block.
import radix, scan.exclusive, workgroups

@group(0) @binding(0) var<storage, read> item_count: array<u32>;
@group(0) @binding(1) var<storage, read> digit_counts: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_values: array<u32>;
@group(0) @binding(6) var<storage, read> digit: array<u32>;

var<workgroup> places: array<u32, DIGITS>;

// Sixteen counts of 16 bits each: a block holds fewer than 65,536 keys, so they add up without carrying over. Digit d
// stands in the upper or lower half of word d / 2.
var<private> counters: array<u32, 8>;

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
    if (thread < DIGITS) {
        places[thread] = digit_counts[thread * blocks + block];
    }
    // A thread takes consecutive keys, so that its counts and those of the threads before it keep equal digits in
    // order.
    let first = block * BLOCK + thread * KEYS_PER_THREAD;
    let end = min(first + KEYS_PER_THREAD, length);
    for (var index = first; index < end; index++) {
        let value = digit_of(keys[index], digit[PLACED]);
        counters[value / 2u] += 1u << (16u * (value % 2u));
    }
    let low = exclusive_scan(vec4u(counters[0], counters[1], counters[2], counters[3]), thread);
    let high = exclusive_scan(vec4u(counters[4], counters[5], counters[6], counters[7]), thread);
    for (var word = 0u; word < 4u; word++) {
        counters[word] = low[word];
        counters[word + 4u] = high[word];
    }
    for (var index = first; index < end; index++) {
        let key = keys[index];
        let value = digit_of(key, digit[PLACED]);
        let half = 16u * (value % 2u);
        let place = places[value] + ((counters[value / 2u] >> half) & 0xffffu);
        counters[value / 2u] += 1u << half;
        sorted_keys[place] = key;
        sorted_values[place] = values[index];
    }
}
