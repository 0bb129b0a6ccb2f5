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
