// Add one view of each Gaussian that it shows to the sums that strategies decide by: the norm of the gradient with
// respect to its projected centre, in half the image's width and height; the number of views; and the largest radius.
// Nothing happens while the run is halted. One thread per Gaussian, in order of depth.
import view, ranks.slots, statistics, splats.read, gradient_rows.gather, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> first_slots: array<u32>;
@group(0) @binding(4) var<storage, read> gradient_rows: array<f32>;
@group(0) @binding(5) var<storage, read> intersection_count: array<u32>;
@group(0) @binding(6) var<storage, read_write> statistics: array<f32>;

// The radius in pixels: the larger variance is one over the lesser eigenvalue of Σ'⁻¹.
fn radius_of(inverse: mat2x2f) -> f32 {
    let middle = 0.5 * (inverse[0].x + inverse[1].y);
    let half_difference = 0.5 * (inverse[0].x - inverse[1].y);
    let spread = sqrt(half_difference * half_difference + inverse[0].y * inverse[0].y);
    return RADIUS_SIGMAS / sqrt(max(middle - spread, 1e-12));
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = folded(workgroup) * THREADS + thread;
    let reached = slots_at(rank);
    if (reached.x == reached.y) {
        return;
    }
    let i = order[rank];
    let inverse = inverse_covariance(read_splat(i));
    let size = vec2f(f32(view.width), f32(view.height));
    let gradient = 0.5 * size * (inverse * gather(i, reached.x, reached.y).offset);
    let radius = radius_of(inverse) / max(size.x, size.y);
    statistics[SCREEN_GRADIENT * view.gaussians + i] += length(gradient);
    statistics[SEEN * view.gaussians + i] += 1.0;
    let largest = RADIUS * view.gaussians + i;
    statistics[largest] = max(statistics[largest], radius);
}
