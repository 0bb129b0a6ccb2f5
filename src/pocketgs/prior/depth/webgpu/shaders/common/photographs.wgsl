// A pixel of `photographs`: red, green and blue from the lowest byte on, and above them the bits MATCHED and USABLE.

// The grey level, in OpenCV's fixed point; black where it is masked, so that masked pixels have no influence.
fn grey_of(pixel: u32) -> u32 {
    let sum = 9798u * (pixel & 255u) + 19235u * ((pixel >> 8u) & 255u) + 3735u * ((pixel >> 16u) & 255u);
    return select(0u, (sum + (1u << 14u)) >> 15u, (pixel & MATCHED) != 0u);
}
