// WGSL lets a compiler assume that no NaN and no infinity occurs, so they are told by their bits.
fn is_finite(value: f32) -> bool {
    return (bitcast<u32>(value) & 0x7f800000u) != 0x7f800000u;
}

fn all_finite(value: vec4f) -> bool {
    return is_finite(value.x) && is_finite(value.y) && is_finite(value.z) && is_finite(value.w);
}
