// Bound the clusters whose bounds do not hold, because a Gaussian in them has moved or changed size. Of numbers that
// are not finite nothing is drawn, so they do not count. One workgroup per cluster.
import view, gaussians.read, clusters, finite, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> shape: array<f32>;
@group(0) @binding(2) var<storage, read_write> cluster_bounds: array<f32>;

// Larger than what is bounded.
const FAR: f32 = 3e38;

// Of each thread's Gaussian, and then of more and more: least coordinates; largest ones and the largest log scale.
var<workgroup> lows: array<vec3f, THREADS>;
var<workgroup> highs: array<vec4f, THREADS>;
var<workgroup> holds: u32;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let cluster = folded(workgroup);
    if (cluster * THREADS >= view.gaussians) {
        return;
    }
    let bounds = cluster * BOUND_WORDS;
    if (thread == 0u) {
        holds = u32(cluster_bounds[bounds + BOUND_HOLDS] == 1.0);
    }
    if (workgroupUniformLoad(&holds) == 1u) {
        return;
    }
    let i = cluster * THREADS + thread;
    lows[thread] = vec3f(FAR);
    highs[thread] = vec4f(-FAR);
    if (i < view.gaussians) {
        let gaussian = read_gaussian(i);
        let scale = gaussian.log_scale;
        if (all_finite(vec4f(gaussian.mean, scale.x)) && all_finite(vec4f(scale, 0.0))) {
            lows[thread] = gaussian.mean;
            highs[thread] = vec4f(gaussian.mean, max(scale.x, max(scale.y, scale.z)));
        }
    }
    for (var reach = THREADS / 2u; reach > 0u; reach = reach / 2u) {
        workgroupBarrier();
        if (thread < reach) {
            lows[thread] = min(lows[thread], lows[thread + reach]);
            highs[thread] = max(highs[thread], highs[thread + reach]);
        }
    }
    workgroupBarrier();
    if (thread < 3u) {
        cluster_bounds[bounds + thread] = lows[0][thread];
        cluster_bounds[bounds + BOUND_HIGH + thread] = highs[0][thread];
    }
    if (thread == 3u) {
        cluster_bounds[bounds + BOUND_LOG_SCALE] = highs[0].w;
        cluster_bounds[bounds + BOUND_HOLDS] = 1.0;
    }
}
