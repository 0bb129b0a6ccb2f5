// The scene's parameters lie column by column, so that neighbouring threads read neighbouring words: `shape` holds
// mean, log scale, quaternion and opacity logit, `sh` coefficient after coefficient, RGB each. The first column of each
// is a constant, such as MEAN, or GRADIENT_MEAN in gradients and moments.

// Stands for an infinite opacity logit: the opacity is 0 or 1 to the last bit. WGSL promises nothing of infinities.
const CERTAIN: f32 = 80.0;

// A Gaussian without its colour. The quaternion is of unit length: w, x, y, z. The opacity logit is not infinite.
struct Gaussian {
    mean: vec3f,
    log_scale: vec3f,
    quaternion: vec4f,
    opacity_logit: f32,
}

// The Gaussian's three axes in the world: the columns of the quaternion's rotation.
fn axes_of(q: vec4f) -> mat3x3f {
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    return mat3x3f(
        vec3f(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        vec3f(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        vec3f(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
}

section read
// Row i of `shape`, which the pass binds.
fn shape_at(column: u32, i: u32) -> f32 {
    return shape[column * view.gaussians + i];
}

fn bounded_logit(logit: f32) -> f32 {
    let bits = bitcast<u32>(logit);
    if ((bits & 0x7fffffffu) != 0x7f800000u) {
        return logit;
    }
    return select(-CERTAIN, CERTAIN, bits == 0x7f800000u);
}

fn read_gaussian(i: u32) -> Gaussian {
    return Gaussian(
        vec3f(shape_at(MEAN, i), shape_at(MEAN + 1u, i), shape_at(MEAN + 2u, i)),
        vec3f(shape_at(LOG_SCALE, i), shape_at(LOG_SCALE + 1u, i), shape_at(LOG_SCALE + 2u, i)),
        vec4f(
            shape_at(QUATERNION, i),
            shape_at(QUATERNION + 1u, i),
            shape_at(QUATERNION + 2u, i),
            shape_at(QUATERNION + 3u, i),
        ),
        bounded_logit(shape_at(OPACITY_LOGIT, i)),
    );
}

section read_sh
// One coefficient's RGB of Gaussian i, from `sh`, which the pass binds.
fn read_coefficient(k: u32, i: u32) -> vec3f {
    let column = 3u * k * view.gaussians + i;
    return vec3f(sh[column], sh[column + view.gaussians], sh[column + 2u * view.gaussians]);
}
