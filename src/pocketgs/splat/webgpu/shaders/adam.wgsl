// One step of Adam (Kingma and Ba 2015, algorithm 1) on all parameters, each group in its own space and with its own
// rate; then noise on the positions, if asked for. The bounds of clusters that have moved hold no longer. Nothing
// happens while the run is halted. One thread per Gaussian, one workgroup per cluster.
import view, update, update.status, update.regularised, gaussians.read, clusters, noise, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> update: Update;
@group(0) @binding(2) var<storage, read> status: array<u32>;
@group(0) @binding(3) var<storage, read> gradients: array<f32>;
@group(0) @binding(4) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(5) var<storage, read_write> second_moments: array<f32>;
@group(0) @binding(6) var<storage, read_write> shape: array<f32>;
@group(0) @binding(7) var<storage, read_write> sh: array<f32>;
@group(0) @binding(8) var<storage, read> cluster_places: array<u32>;
@group(0) @binding(9) var<storage, read_write> cluster_bounds: array<f32>;

// Whether gradients of this cluster were written; what was not stands for 0.
var<private> is_written: bool;

// Update the moments of one column; returns the step to take, before its rate.
fn direction(column: u32, i: u32) -> f32 {
    let place = column * view.gaussians + i;
    var gradient = 0.0;
    if (is_written) {
        gradient = gradients[place];
    }
    let first = update.decay1 * first_moments[place] + (1.0 - update.decay1) * gradient;
    let second = update.decay2 * second_moments[place] + (1.0 - update.decay2) * gradient * gradient;
    first_moments[place] = first;
    second_moments[place] = second;
    return first * update.unbias1 / (sqrt(second * update.unbias2) + update.epsilon);
}

fn has_gradient(i: u32) -> bool {
    for (var column = 0u; is_written && column < GRADIENT_SH + 3u * view.coefficients; column++) {
        if (gradients[column * view.gaussians + i] != 0.0) {
            return true;
        }
    }
    return false;
}

fn direction3(column: u32, i: u32) -> vec3f {
    return vec3f(direction(column, i), direction(column + 1u, i), direction(column + 2u, i));
}

fn move_shape(column: u32, i: u32, step: vec3f) {
    for (var axis = 0u; axis < 3u; axis++) {
        shape[(column + axis) * view.gaussians + i] -= step[axis];
    }
}

// sin(x)/x and cos(x) by their series below 1/2. WGSL promises a sine only to 2⁻¹¹, more than the angle of a usual step.
fn sinc_and_cosine(x: f32) -> vec2f {
    if (x > 0.5) {
        return vec2f(sin(x) / x, cos(x));
    }
    let square = x * x;
    let sinc = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0));
    let cosine = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0)));
    return vec2f(sinc, cosine);
}

// Q ⊗ exp(½ δ), normalised.
fn turned(q: vec4f, delta: vec3f) -> vec4f {
    let parts = sinc_and_cosine(0.5 * length(delta));
    let v = 0.5 * parts.x * delta;
    let c = parts.y;
    return normalize(vec4f(q.x * c - dot(q.yzw, v), q.x * v + c * q.yzw + cross(q.yzw, v)));
}

fn update_parameters(i: u32) {
    let n = view.gaussians;
    move_shape(MEAN, i, update.mean_rate * direction3(GRADIENT_MEAN, i));
    move_shape(LOG_SCALE, i, update.log_scale_rate * direction3(GRADIENT_LOG_SCALE, i));
    var q: vec4f;
    for (var k = 0u; k < 4u; k++) {
        q[k] = shape[(QUATERNION + k) * n + i];
    }
    q = turned(q, -update.rotation_rate * direction3(GRADIENT_ROTATION, i));
    for (var k = 0u; k < 4u; k++) {
        shape[(QUATERNION + k) * n + i] = q[k];
    }
    shape[OPACITY_LOGIT * n + i] -= update.opacity_rate * direction(GRADIENT_OPACITY, i);
    for (var column = 0u; column < 3u * update.trained_coefficients; column++) {
        let rate = select(update.sh_rest_rate, update.sh_dc_rate, column < 3u);
        sh[column * n + i] -= rate * direction(GRADIENT_SH + column, i);
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let cluster = folded(workgroup);
    let i = cluster * THREADS + thread;
    if (i >= view.gaussians || status[HALTED] != 0u) {
        return;
    }
    is_written = cluster_places[cluster] != OUTSIDE || is_regularised();
    if (update.seen_only != 0u && !is_written && update.noise_size == 0.0) {
        return;
    }
    if (thread == 0u) {
        cluster_bounds[cluster * BOUND_WORDS + BOUND_HOLDS] = 0.0;
    }
    if (update.seen_only == 0u || has_gradient(i)) {
        update_parameters(i);
    }
    if (update.noise_size != 0.0) {
        move_shape(MEAN, i, -noise_of(read_gaussian(i), update.noise_size, update.noise_seed, i));
    }
}
