// Add the gradient of λ_s mean ‖log s‖² + λ_α mean α (the PocketGS paper's total loss) + λ_r mean Σ s (3DGS-MCMC's),
// and write its parts of the loss. One thread per Gaussian, one workgroup per cluster.
import view, update, gaussians.read, clusters, workgroups, workgroups.sum

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> update: Update;
@group(0) @binding(2) var<storage, read> shape: array<f32>;
@group(0) @binding(3) var<storage, read_write> gradients: array<f32>;
@group(0) @binding(4) var<storage, read_write> regulariser_parts: array<f32>;
@group(0) @binding(5) var<storage, read> cluster_places: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let group = folded(workgroup);
    if (group * THREADS >= view.gaussians) {
        return;
    }
    let i = group * THREADS + thread;
    var value = 0.0;
    if (i < view.gaussians) {
        // Nothing stands there yet of clusters outside the view.
        let columns = select(0u, GRADIENT_SH + 3u * view.coefficients, cluster_places[group] == OUTSIDE);
        for (var column = 0u; column < columns; column++) {
            gradients[column * view.gaussians + i] = 0.0;
        }
        for (var axis = 0u; axis < 3u; axis++) {
            let log_scale = shape_at(LOG_SCALE + axis, i);
            let size = select(0.0, update.size_weight * exp(log_scale), update.size_weight != 0.0);
            value += update.scale_weight * log_scale * log_scale + size;
            gradients[(GRADIENT_LOG_SCALE + axis) * view.gaussians + i] += 2.0 * update.scale_weight * log_scale + size;
        }
        let opacity = 1.0 / (1.0 + exp(-shape_at(OPACITY_LOGIT, i)));
        value += update.opacity_weight * opacity;
        gradients[GRADIENT_OPACITY * view.gaussians + i] += update.opacity_weight * opacity * (1.0 - opacity);
    }
    let sum = workgroup_sum(value, thread);
    if (thread == 0u) {
        regulariser_parts[group] = sum;
    }
}
