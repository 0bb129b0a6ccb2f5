// Running sums over the 256 threads of a workgroup: within each subgroup at once, then over the subgroups' sums.
enable subgroups;
import scan_shared_memory

// Whether all subgroups are of one size and their threads consecutive and in order, which WGSL does not promise.
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
        in_order = 1u;
        subgroup_size = lanes;
    }
    workgroupBarrier();
    if (thread != first + lane || first % lanes != 0u || THREADS % lanes != 0u || lanes != subgroup_size) {
        in_order = 0u;
    }
    if (lane == lanes - 1u) {
        running_sums[subgroup] = before + value;
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
