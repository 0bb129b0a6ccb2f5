// Gradients from the image back to the Gaussians, through the sort permutation: ∇θ[π(i)] = g_i, 0 where no tile is
// reached. Those of clusters outside the view are not written. One thread per Gaussian, in order of depth.
import view, ranks.slots, gaussians.read, gaussians.read_sh, projection, lens.backward, splats.read
import spherical_harmonics.gradient, gradient_rows.gather, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(2) var<storage, read> shape: array<f32>;
@group(0) @binding(3) var<storage, read> sh: array<f32>;
@group(0) @binding(4) var<storage, read> splats: array<u32>;
@group(0) @binding(5) var<storage, read> order: array<u32>;
@group(0) @binding(6) var<storage, read> first_slots: array<u32>;
@group(0) @binding(7) var<storage, read> gradient_rows: array<f32>;
@group(0) @binding(8) var<storage, read_write> gradients: array<f32>;
@group(0) @binding(9) var<storage, read> intersection_count: array<u32>;

// As in `project.wgsl`.
override antialiased: bool = false;

fn write_gradient(column: u32, i: u32, value: f32) {
    gradients[column * view.gaussians + i] = value;
}

fn write_gradient3(column: u32, i: u32, value: vec3f) {
    write_gradient(column, i, value.x);
    write_gradient(column + 1u, i, value.y);
    write_gradient(column + 2u, i, value.z);
}

// With Q = Σ'⁻¹ and v the gradient of each pixel's exponent, ∂L/∂μ = Q Σ v d and ∂L/∂Q = -½ Σ v d dᵀ, and
// ∂L/∂Σ' = -Q ∂L/∂Q Q.
fn covariance_gradient(inverse: mat2x2f, sums: SplatSums) -> mat2x2f {
    let moments = mat2x2f(sums.square.x, sums.square.y, sums.square.y, sums.square.z);
    return 0.5 * (inverse * moments * inverse);
}

// ∂L/∂Σ' through the factor √(det Σ / det Σ') of the opacity. The gradient of its logarithm is ½ (Σ⁻¹ - Σ'⁻¹); the
// logarithm of an opacity has the gradient of the pixels' exponents.
fn compensation_gradient(gaussian: Gaussian, jacobian: Jacobian, d_exponent: f32) -> mat2x2f {
    let sharp = footprint_of(view, gaussian, jacobian);
    let blurred = sharp.determinant + LOW_PASS * (sharp.xx + sharp.yy + LOW_PASS);
    let adjugate = mat2x2f(sharp.yy, -sharp.xy, -sharp.xy, sharp.xx);
    let sharp_inverse = adjugate * (1.0 / sharp.determinant);
    let blurred_inverse = (adjugate + mat2x2f(LOW_PASS, 0.0, 0.0, LOW_PASS)) * (1.0 / blurred);
    return 0.5 * d_exponent * (sharp_inverse - blurred_inverse);
}

// Write the gradients of scales and rotation; return that of the Jacobian.
fn shape_backward(gaussian: Gaussian, jacobian: Jacobian, d_covariance: mat2x2f, i: u32) -> Jacobian {
    let axes = axes_of(gaussian.quaternion);
    let scale = exp(gaussian.log_scale);
    var d_jacobian = Jacobian();
    // Row k of `skew` is axis k's part of Rᵀ ∂L/∂R, transposed.
    var skew: mat3x3f;
    var d_log_scale = vec3f();
    for (var k = 0u; k < 3u; k++) {
        let a = rotate_to_camera(view, scale[k] * axes[k]);
        let du = 2.0 * (d_covariance * project_vector(jacobian, a));
        d_jacobian.x += du.x * a;
        d_jacobian.y += du.y * a;
        let d_a = du.x * jacobian.x + du.y * jacobian.y;
        let d_axis = scale[k] * to_world(view, d_a);
        d_log_scale[k] = dot(axes[k], d_axis);
        skew[k] = vec3f(dot(axes[0], d_axis), dot(axes[1], d_axis), dot(axes[2], d_axis));
    }
    write_gradient3(GRADIENT_LOG_SCALE, i, d_log_scale);
    // q ← q ⊗ exp(½δ) turns R into R exp([δ]×).
    let d_rotation = vec3f(skew[1].z - skew[2].y, skew[2].x - skew[0].z, skew[0].y - skew[1].x);
    write_gradient3(GRADIENT_ROTATION, i, d_rotation);
    return d_jacobian;
}

// Write the gradient of the SH coefficients; return that of the world position through the viewing direction.
fn colour_backward(mean: vec3f, d_colour: vec3f, i: u32) -> vec3f {
    let offset = mean - view.centre.xyz;
    let distance = length(offset);
    let direction = offset / distance;
    var colour = vec3f(0.5);
    for (var k = 0u; k < view.coefficients; k++) {
        colour += harmonic(k, direction) * read_coefficient(k, i);
    }
    // Negative colours are cut to 0.
    let lit = select(vec3f(), d_colour, colour > vec3f());
    var d_direction = vec3f();
    for (var k = 0u; k < view.coefficients; k++) {
        write_gradient3(GRADIENT_SH + 3u * k, i, harmonic(k, direction) * lit);
        d_direction += dot(read_coefficient(k, i), lit) * harmonic_gradient(k, direction);
    }
    // A unit vector's derivative keeps only what is across it.
    return (d_direction - dot(direction, d_direction) * direction) / distance;
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = folded(workgroup) * THREADS + thread;
    let reached = slots_at(rank);
    if (rank >= intersection_count[RANKS]) {
        return;
    }
    let i = order[rank];
    if (reached.x == reached.y) {
        for (var column = 0u; column < GRADIENT_SH + 3u * view.coefficients; column++) {
            write_gradient(column, i, 0.0);
        }
        return;
    }
    let splat = read_splat(i);
    let sums = gather(i, reached.x, reached.y);
    let inverse = inverse_covariance(splat);
    let gaussian = read_gaussian(i);
    let local = to_camera(view, gaussian.mean);
    let jacobian = jacobian_at(view, local);
    var d_covariance = covariance_gradient(inverse, sums);
    if (antialiased) {
        d_covariance += compensation_gradient(gaussian, jacobian, sums.exponent);
    }
    let d_jacobian = shape_backward(gaussian, jacobian, d_covariance, i);
    let d_local = position_backward(view, local, jacobian, inverse * sums.offset, d_jacobian);
    write_gradient3(GRADIENT_MEAN, i, to_world(view, d_local) + colour_backward(gaussian.mean, sums.colour, i));
    write_gradient(GRADIENT_OPACITY, i, sums.exponent / (1.0 + exp(gaussian.opacity_logit)));
}
