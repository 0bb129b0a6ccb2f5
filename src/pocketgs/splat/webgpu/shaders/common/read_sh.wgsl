// One coefficient's RGB of Gaussian i, from `sh`, which the pass binds.
fn read_coefficient(k: u32, i: u32) -> vec3f {
    let column = 3u * k * view.gaussians + i;
    return vec3f(sh[column], sh[column + view.gaussians], sh[column + 2u * view.gaussians]);
}
