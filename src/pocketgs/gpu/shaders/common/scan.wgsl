// Running sums over the 256 threads of a workgroup through workgroup memory (Hillis and Steele 1986).
var<workgroup> running_sums: array<vec4u, THREADS>;

fn shared_scan(value: vec4u, thread: u32) -> vec4u {
    workgroupBarrier();
    running_sums[thread] = value;
    workgroupBarrier();
    var sum = value;
    for (var reach = 1u; reach < THREADS; reach = 2u * reach) {
        if (thread >= reach) {
            sum += running_sums[thread - reach];
        }
        workgroupBarrier();
        running_sums[thread] = sum;
        workgroupBarrier();
    }
    return sum - value;
}

// The sum over all threads, after a scan.
fn scan_total() -> vec4u {
    return running_sums[THREADS - 1u];
}

section shared
// Running sums on any device.

// The sum over the threads before this one. Every thread of the workgroup must call it.
fn exclusive_scan(value: vec4u, thread: u32) -> vec4u {
    return shared_scan(value, thread);
}

section subgroup
enable subgroups;
// Running sums over the 256 threads of a workgroup: within each subgroup at once, then over the subgroups' sums.

// Whether all subgroups are of one size and their threads consecutive and in order, which WGSL does not promise.
var<workgroup> disorder: atomic<u32>;
var<workgroup> in_order: u32;
var<workgroup> subgroup_size: u32;

// The sum over the threads before this one. Every thread of the workgroup must call it.
fn exclusive_scan(value: vec4u, thread: u32) -> vec4u {
    let before = subgroupExclusiveAdd(value);
    let lane = subgroupExclusiveAdd(1u);
    let lanes = subgroupAdd(1u);
    let first = subgroupMin(thread);
    let subgroup = thread / lanes;
    workgroupBarrier();
    if (thread == 0u) {
        atomicStore(&disorder, 0u);
        subgroup_size = lanes;
    }
    workgroupBarrier();
    if (thread != first + lane || first % lanes != 0u || THREADS % lanes != 0u || lanes != subgroup_size) {
        atomicStore(&disorder, 1u);
    }
    if (lane == lanes - 1u) {
        running_sums[subgroup] = before + value;
    }
    workgroupBarrier();
    if (thread == 0u) {
        in_order = 1u - atomicLoad(&disorder);
    }
    if (workgroupUniformLoad(&in_order) == 0u) {
        return shared_scan(value, thread);
    }
    var sum = before;
    var total = vec4u();
    for (var other = 0u; other < THREADS / lanes; other++) {
        let other_sum = running_sums[other];
        sum += select(vec4u(), other_sum, other < subgroup);
        total += other_sum;
    }
    workgroupBarrier();
    if (thread == THREADS - 1u) {
        running_sums[thread] = total;
    }
    workgroupBarrier();
    return sum;
}

section in_place
import radix, scan.exclusive
// Turn `counts`, which the pass binds, into running sums, in place, each without itself; one workgroup walks over all.
//
// Sums that 32 bits do not hold stay at FULL, more than there is ever room for: the upper halves of the counts are
// summed beside them, and show in time when the sums come near.

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
