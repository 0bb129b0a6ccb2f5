// A projected Gaussian. Its exponent is held to base 2, with the opacity inside:
// log2 α(dx, dy) = log2_opacity + exponents.x dx² + exponents.y dx dy + exponents.z dy².
struct Splat {
    mean: vec2f,
    depth: f32,
    log2_opacity: f32,
    exponents: vec3f,
    colour: vec3f,
}

fn exponent_at(splat: Splat, offset: vec2f) -> f32 {
    let e = splat.exponents;
    return splat.log2_opacity + e.x * offset.x * offset.x + offset.y * (e.y * offset.x + e.z * offset.y);
}
