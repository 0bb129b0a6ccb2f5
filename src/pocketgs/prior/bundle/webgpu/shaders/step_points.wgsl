// The points' steps for a step of the cameras, and what they add to the decrease that the linear model expects. One thread
// per point.
import reprojection, blocks.point, blocks.sight, workgroups

@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> frames: array<u32>;
@group(0) @binding(3) var<storage, read> point_blocks: array<f32>;
@group(0) @binding(4) var<storage, read> sights: array<f32>;
@group(0) @binding(5) var<storage, read> camera_step: array<f32>;
@group(0) @binding(6) var<storage, read_write> point_steps: array<vec4f>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = folded(workgroup) * THREADS + thread;
    if (i >= adjustment.points) {
        return;
    }
    var right = vector_of(i, GRADIENT);
    for (var k = starts[i]; k < starts[i + 1u]; k++) {
        for (var a = 0u; a < CAMERA_UNKNOWNS; a++) {
            right -= coupling_of(k, a) * camera_step[CAMERA_UNKNOWNS * frames[k] + a];
        }
    }
    let moved = inverse_of(i) * right;
    point_steps[i] = vec4f(moved, 0.5 * dot(moved, vector_of(i, DAMPING) * moved + vector_of(i, GRADIENT)));
}
