// Where the entries of each block of Gaussians begin: running sums of the blocks' sums. One workgroup.
import view, scan_counts

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    scan_counts((view.gaussians + BLOCK - 1u) / BLOCK, thread);
}
