// Project every Gaussian of the clusters in view into the image: Σ' = J W Σ Wᵀ Jᵀ + 0.3 I (3DGS, equation 5). Writes
// its splat, the depth that it is sorted by or the weight that it has instead, and the number of tiles it reaches. One
// thread per Gaussian, one workgroup per cluster.
import view, gaussians.read, gaussians.read_sh, projection, spherical_harmonics, splats.words, appearance.kind, tiles
import depth_keys.kind, weights.kind, clusters, finite, hash, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(2) var<storage, read> shape: array<f32>;
@group(0) @binding(3) var<storage, read> sh: array<f32>;
@group(0) @binding(4) var<storage, read_write> splats: array<u32>;
@group(0) @binding(5) var<storage, read_write> order: array<u32>;
@group(0) @binding(6) var<storage, read_write> tile_counts: array<u32>;
@group(0) @binding(7) var<storage, read> cluster_places: array<u32>;

// Whether opacities are multiplied by √(det Σ / det Σ') with Σ = Σ' - 0.3 I, so that Gaussians smaller than a pixel fade
// in place of covering a whole one (Mip-Splatting, Yu et al. 2024, equation 10).
override antialiased: bool = false;

struct Projected {
    splat: Splat,
    visible: bool,
}

// Where, how large and how opaque the Gaussian appears, without its colour.
fn project_shape(gaussian: Gaussian) -> Projected {
    var result = Projected(Splat(), false);
    let local = to_camera(view, gaussian.mean);
    let logit = gaussian.opacity_logit;
    // log2 of the logistic function: of either sign of the logit, what is exponentiated is at most 0.
    var log2_opacity = min(logit, 0.0) * LOG2_E - log2(1.0 + exp2(-abs(logit) * LOG2_E));
    let sound = all_finite(vec4f(gaussian.mean, logit)) && all_finite(gaussian.quaternion)
        && all_finite(vec4f(gaussian.log_scale, 0.0)) && all(gaussian.log_scale < vec3f(MAX_LOG_SCALE));
    let depth = depth_of(local);
    if (!(sound && depth >= view.near && log2_opacity >= LOG2_ALPHA_MIN)) {
        return result;
    }
    let scale = exp(gaussian.log_scale);
    if (!is_shown(view, local, max(scale.x, max(scale.y, scale.z)))) {
        return result;
    }
    let sharp = footprint_of(view, gaussian, jacobian_at(view, local));
    let xx = sharp.xx + LOW_PASS;
    let yy = sharp.yy + LOW_PASS;
    if (!(xx < MAX_VARIANCE && yy < MAX_VARIANCE)) {
        return result;
    }
    let determinant = sharp.determinant + LOW_PASS * (xx + yy - LOW_PASS);
    if (antialiased) {
        log2_opacity += 0.5 * log2(sharp.determinant / determinant);
        if (!(log2_opacity >= LOG2_ALPHA_MIN)) {
            return result;
        }
    }
    let mean = project_point(view, local);
    let reach = sqrt(max(0.0, 2.0 * (log2_opacity - LOG2_ALPHA_MIN) / LOG2_E));
    let radii = reach * vec2f(sqrt(xx), sqrt(yy));
    if (!(all_finite(vec4f(mean, radii)) && determinant > MIN_DETERMINANT * xx * yy)) {
        return result;
    }
    let columns = tiles_between(mean.x - radii.x, mean.x + radii.x, view.width);
    let rows = tiles_between(mean.y - radii.y, mean.y + radii.y, view.height);
    result.visible = columns.x < columns.y && rows.x < rows.y;
    result.splat.mean = mean;
    result.splat.depth = depth;
    result.splat.log2_opacity = log2_opacity;
    result.splat.exponents = LOG2_E * vec3f(-0.5 * yy, sharp.xy, -0.5 * xx) / determinant;
    return result;
}

fn colour_of(mean: vec3f, i: u32) -> vec3f {
    let direction = normalize(mean - view.centre.xyz);
    var colour = vec3f(0.5);
    for (var k = 0u; k < view.coefficients; k++) {
        colour += harmonic(k, direction) * read_coefficient(k, i);
    }
    return colour;
}

fn is_dropped_out(i: u32) -> bool {
    return pcg_hash(pcg_hash(view.dropout_seed) ^ i) < view.dropout_threshold;
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let cluster = folded(workgroup);
    let i = cluster * THREADS + thread;
    if (i >= view.gaussians || cluster_places[cluster] == OUTSIDE) {
        return;
    }
    let key = cluster_places[cluster] * THREADS + thread;
    order[key] = i;
    leave_out(key);
    tile_counts[i] = 0u;
    if (is_dropped_out(i)) {
        return;
    }
    let gaussian = read_gaussian(i);
    var projected = project_shape(gaussian);
    if (!projected.visible) {
        return;
    }
    let colour = colour_of(gaussian.mean, i);
    let weight = weight_of(gaussian, i);
    if (!(all_finite(vec4f(colour, weight)) && all(abs(colour) < vec3f(BRIGHTEST)))) {
        return;
    }
    projected.splat.colour = max(colour, vec3f());
    projected.splat.weight = weight;
    let words = pack_splat(appear(projected.splat));
    for (var w = 0u; w < SPLAT_WORDS; w++) {
        splats[i * SPLAT_WORDS + w] = words[w];
    }
    enter(key, projected.splat.depth);
    note_weight(projected.splat);
    // As the lists will see it: stored precision included.
    tile_counts[i] = count_tiles(view, unpack_splat(words));
}
