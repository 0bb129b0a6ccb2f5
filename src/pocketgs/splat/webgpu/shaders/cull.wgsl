// Give every cluster that the view may see something of its place among them, in the order of memory; and count the
// Gaussians in them. One workgroup.
import view, clusters, finite, scan.exclusive, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> cluster_bounds: array<f32>;
@group(0) @binding(2) var<storage, read_write> cluster_places: array<u32>;
@group(0) @binding(3) var<storage, read_write> gaussian_count: array<u32>;

// What sums in float32 may be off, and more, as a share of what they sum.
const ROUNDING: f32 = 1e-5;

// A box around means, and the largest standard deviation of what is in it.
struct Bounds {
    low: vec3f,
    high: vec3f,
    sigma: f32,
}

fn bounds_of(cluster: u32) -> Bounds {
    let first = cluster * BOUND_WORDS;
    let high = first + BOUND_HIGH;
    return Bounds(
        vec3f(cluster_bounds[first], cluster_bounds[first + 1u], cluster_bounds[first + 2u]),
        vec3f(cluster_bounds[high], cluster_bounds[high + 1u], cluster_bounds[high + 2u]),
        exp(cluster_bounds[first + BOUND_LOG_SCALE]),
    );
}

// The largest value in a box of a function that is linear in camera space: at a corner.
fn largest(plane: vec4f, box: Bounds) -> f32 {
    let middle = 0.5 * box.low + 0.5 * box.high;
    let half = 0.5 * box.high - 0.5 * box.low;
    let summed = dot(abs(plane.xyz), max(abs(box.low), abs(box.high))) + abs(plane.w);
    return dot(plane.xyz, middle) + plane.w + dot(abs(plane.xyz), half) + ROUNDING * summed;
}

// What is not finite is never below.
fn is_below(value: f32, limit: f32) -> bool {
    return is_finite(value) && value < limit;
}

// With r the reach and σ a standard deviation, a Gaussian at camera-space (x, y, z) reaches to the right at most to f
// x/z + c + r (f/z √(1 + s²) σ + √0.3), s being the largest slope that its Jacobian is evaluated at. If that is left of
// the first pixel's centre, all of it times z is a linear function of the mean that is below 0.
fn is_outside_axis(box: Bounds, axis: u32, row: vec4f, size: f32) -> bool {
    // Of the most opaque Gaussian, in standard deviations, with some room for rounding.
    let reach = 1.001 * sqrt(-2.0 * LOG2_ALPHA_MIN / LOG2_E);
    let focal = view.focal[axis];
    let centre = view.principal[axis];
    let slope = max(abs(view.slopes_low[axis]), abs(view.slopes_high[axis]));
    let spread = reach * focal * sqrt(1.0 + slope * slope) * box.sigma;
    let blur = reach * sqrt(LOW_PASS) + 0.5;
    let before = focal * row + (centre + blur) * view.to_camera_z;
    let behind = -focal * row + (size - centre + blur) * view.to_camera_z;
    return is_below(largest(before, box) + spread, 0.0) || is_below(largest(behind, box) + spread, 0.0);
}

fn is_in_view(cluster: u32) -> bool {
    let box = bounds_of(cluster);
    let empty = box.low.x > box.high.x;
    return !(empty || is_below(largest(view.to_camera_z, box), view.near)
        || is_outside_axis(box, 0u, view.to_camera_x, f32(view.width))
        || is_outside_axis(box, 1u, view.to_camera_y, f32(view.height)));
}

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    let clusters = (view.gaussians + THREADS - 1u) / THREADS;
    var clusters_before = 0u;
    var gaussians_before = 0u;
    for (var start = 0u; start < clusters; start += THREADS) {
        let cluster = start + thread;
        var found = vec4u();
        if (cluster < clusters && is_in_view(cluster)) {
            found = vec4u(1u, min(THREADS, view.gaussians - cluster * THREADS), 0u, 0u);
        }
        let before = exclusive_scan(found, thread);
        if (cluster < clusters) {
            cluster_places[cluster] = select(OUTSIDE, clusters_before + before.x, found.x == 1u);
        }
        clusters_before += scan_total().x;
        gaussians_before += scan_total().y;
    }
    if (thread == 0u) {
        gaussian_count[0] = gaussians_before;
    }
}
