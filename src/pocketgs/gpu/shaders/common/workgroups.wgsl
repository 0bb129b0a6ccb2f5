// No dimension of a dispatch may exceed MAX_ROW_LENGTH workgroups, so long ones are folded into rows of that length.
fn folded(workgroup: vec3u) -> u32 {
    return workgroup.y * MAX_ROW_LENGTH + workgroup.x;
}

section sum
// The sum of a number over the 256 threads of a workgroup, always in the same order.
var<workgroup> partial_sums: array<f32, THREADS>;

// Every thread of the workgroup must call it; thread 0 gets the sum.
fn workgroup_sum(value: f32, thread: u32) -> f32 {
    workgroupBarrier();
    partial_sums[thread] = value;
    for (var reach = THREADS / 2u; reach > 0u; reach = reach / 2u) {
        workgroupBarrier();
        if (thread < reach) {
            partial_sums[thread] += partial_sums[thread + reach];
        }
    }
    workgroupBarrier();
    return partial_sums[0];
}
