// H_cp H_pp⁻¹ H_pc of two cameras, over the points that both see. One thread per pair and entry.
import reprojection, blocks.sight, blocks.eliminated, workgroups

@group(0) @binding(1) var<storage, read> pair_starts: array<u32>;
// Observations of one point, by the first and by the second camera of the pair.
@group(0) @binding(2) var<storage, read> meetings: array<vec2u>;
@group(0) @binding(3) var<storage, read> sights: array<f32>;
@group(0) @binding(4) var<storage, read> eliminated: array<f32>;
@group(0) @binding(5) var<storage, read_write> pair_sums: array<f32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let place = folded(workgroup) * THREADS + thread;
    let pair = place / PAIR_SUMS;
    if (pair >= adjustment.pairs) {
        return;
    }
    let row = place % PAIR_SUMS / CAMERA_UNKNOWNS;
    let column = place % CAMERA_UNKNOWNS;
    var sum = 0.0;
    for (var k = pair_starts[pair]; k < pair_starts[pair + 1u]; k++) {
        sum += dot(eliminated_of(meetings[k].x, row), coupling_of(meetings[k].y, column));
    }
    pair_sums[place] = sum;
}
