// The keys of the second sort, in the order of the first. One thread per candidate.
import merging, workgroups

@group(0) @binding(1) var<storage, read> hashes: array<vec2u>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read_write> keys: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = folded(workgroup) * THREADS + thread;
    if (rank < merging.candidates) {
        keys[rank] = hashes[order[rank]].y;
    }
}
