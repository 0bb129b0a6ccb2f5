// The photograph's pixel from `photographs`, which the pass binds: RGB in [0, 1] from 8 bits each, and in the fourth
// whether it counts. What lies outside a mask counts as if the photograph showed what was rendered there.
fn photograph_at(pixel: u32) -> vec4f {
    return unpack4x8unorm(photographs[view.photograph + pixel]);
}
