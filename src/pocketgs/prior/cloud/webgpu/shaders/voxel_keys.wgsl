// Two hashes of the voxel that a candidate lies in: two voxels have both in common about once in 2^64 pairs. The first is
// also the key of the first sort. One thread per candidate.
import merging, workgroups

@group(0) @binding(1) var<storage, read> positions: array<f32>;
@group(0) @binding(2) var<storage, read> levels: array<u32>;
// Of each level: where the grid's cell begins that the origin lies in, as a share of a cell, and cells per unit of length.
@group(0) @binding(3) var<storage, read> grids: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> hashes: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> order: array<u32>;

// Odd numbers without a pattern: a sum of products with them is the same for two cells only if their difference makes
// it 0, which no difference of some thousand cells is likely to.
const FIRST_FACTORS = vec4u(0x7f4a7c15u, 0x1ce4e5b9u, 0x133111ebu, 0x8659fd93u);
const SECOND_FACTORS = vec4u(0x9e3779b9u, 0xbf58476du, 0x94d049bbu, 0xd6e8feb9u);

fn hash(cell: vec3i, level: u32, factors: vec4u) -> u32 {
    let parts = bitcast<vec3u>(cell) * factors.xyz;
    return parts.x + parts.y + parts.z + level * factors.w;
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = folded(workgroup) * THREADS + thread;
    if (i >= merging.candidates) {
        return;
    }
    let position = vec3f(positions[3u * i], positions[3u * i + 1u], positions[3u * i + 2u]);
    let level = levels[i];
    let grid = grids[level];
    let cell = vec3i(floor(position * grid.w + grid.xyz));
    let first = hash(cell, level, FIRST_FACTORS);
    keys[i] = first;
    hashes[i] = vec2u(first, hash(cell, level, SECOND_FACTORS));
    order[i] = i;
}
