// Which clusters a view may see something of, from their bounds. The pass binds `cluster_bounds`.
import view, clusters, finite

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

// At least the reach of the most opaque Gaussian in standard deviations, with some room for rounding.
fn largest_reach() -> f32 {
    return 1.001 * sqrt(-2.0 * LOG2_ALPHA_MIN / LOG2_E);
}

// What the low pass adds to every Gaussian's reach, and half a pixel, in pixels.
fn blur() -> f32 {
    return largest_reach() * sqrt(LOW_PASS) + 0.5;
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

section sides
// In terms of `is_outside_axis`, which says whether all of a box is outside the image along one axis.
fn is_in_view(cluster: u32) -> bool {
    let box = bounds_of(cluster);
    let empty = box.low.x > box.high.x;
    return !(empty || is_below(largest(view.to_camera_z, box), view.near)
        || is_outside_axis(box, 0u, view.to_camera_x, f32(view.width))
        || is_outside_axis(box, 1u, view.to_camera_y, f32(view.height)));
}

section pinhole
import lens, frustum.sides
// With r the reach and σ a standard deviation, a Gaussian at camera-space (x, y, z) reaches to the right at most to f
// x/z + c + r (f/z √(1 + s²) σ + √0.3), s being the largest slope that its Jacobian is evaluated at. If that is left of
// the first pixel's centre, all of it times z is a linear function of the mean that is below 0.
fn is_outside_axis(box: Bounds, axis: u32, row: vec4f, size: f32) -> bool {
    let focal = view.focal[axis];
    let centre = view.principal[axis];
    let slope = max(abs(view.slopes_low[axis]), abs(view.slopes_high[axis]));
    let spread = largest_reach() * focal * sqrt(1.0 + slope * slope) * box.sigma;
    let before = focal * row + (centre + blur()) * view.to_camera_z;
    let behind = -focal * row + (size - centre + blur()) * view.to_camera_z;
    return is_below(largest(before, box) + spread, 0.0) || is_below(largest(behind, box) + spread, 0.0);
}

section orthographic
import lens, frustum.sides
// A pixel is a linear function of the mean, and no Gaussian grows towards the camera.
fn is_outside_axis(box: Bounds, axis: u32, row: vec4f, size: f32) -> bool {
    let focal = view.focal[axis];
    let centre = view.principal[axis];
    let spread = largest_reach() * focal * box.sigma + blur();
    return is_below(largest(focal * row, box) + centre + spread, 0.0)
        || is_below(largest(-focal * row, box) + size - centre + spread, 0.0);
}

section bent
import lens.kind
const HALF_TURN: f32 = 3.1415927;

// Of angles, in radians: WGSL's trigonometric functions are coarse.
const ANGLE_ERROR: f32 = 0.01;

// A lens bends straight sides. But a ball around the box has no mean closer to the axis than a certain angle; the lens
// shows what is beyond it at least `least_radius` times that angle from the principal point; and no Gaussian reaches
// further than its largest standard deviation lets it at the ball's nearest point.
fn is_in_view(cluster: u32) -> bool {
    let box = bounds_of(cluster);
    let empty = box.low.x > box.high.x;
    let middle = to_camera(view, 0.5 * box.low + 0.5 * box.high);
    let radius = length(0.5 * box.high - 0.5 * box.low);
    let distance = length(middle);
    let spread = select(HALF_TURN, asin(min(radius / distance, 1.0)), distance > radius);
    let least = max(acos(clamp(middle.z / distance, -1.0, 1.0)) - spread - ANGLE_ERROR, 0.0);
    let depth = depth_of(middle);
    let reach = largest_reach() * lens.stretch * max(view.focal.x, view.focal.y) * box.sigma;
    let corner = length(max(view.principal, vec2f(f32(view.width), f32(view.height)) - view.principal));
    let furthest = corner + blur() + reach / max(depth - radius, view.near);
    let shown = min(view.focal.x, view.focal.y) * lens.least_radius * least;
    return !(empty || is_below(-least, -lens.largest_angle) || is_below(depth + radius, view.near)
        || is_below(furthest - shown, 0.0));
}
