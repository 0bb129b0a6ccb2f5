// Whether a candidate is the first of its voxel. One thread per candidate, in the order of the sort.
import merging, workgroups

@group(0) @binding(1) var<storage, read> hashes: array<vec2u>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read_write> heads: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = folded(workgroup) * THREADS + thread;
    if (rank >= merging.candidates) {
        return;
    }
    let own = hashes[order[rank]];
    let before = hashes[order[max(rank, 1u) - 1u]];
    heads[order[rank]] = select(0u, 1u, rank == 0u || any(own != before));
}
