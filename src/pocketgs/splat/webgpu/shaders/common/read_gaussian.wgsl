// Row i of `shape`, which the pass binds.
fn shape_at(column: u32, i: u32) -> f32 {
    return shape[column * view.gaussians + i];
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
        shape_at(OPACITY_LOGIT, i),
    );
}
