// A workgroup takes a patch of PATCH x PATCH pixels, and reads it with a margin of half a window of SSIM around it.
const WINDOW: u32 = 2u * MARGIN + 1u;
const PADDED: u32 = PATCH + 2u * MARGIN;
const PADDED_PIXELS: u32 = PADDED * PADDED;
// The padded patch, filtered along its rows.
const STRIP_PIXELS: u32 = PADDED * PATCH;

// Row-major index of a pixel of the image, for a place of the patch; false outside the image.
struct PatchPixel {
    index: u32,
    inside: bool,
}

fn patch_pixel(view: View, corner: vec2u, place: u32) -> PatchPixel {
    let x = i32(corner.x + place % PADDED) - i32(MARGIN);
    let y = i32(corner.y + place / PADDED) - i32(MARGIN);
    let inside = x >= 0 && y >= 0 && x < i32(view.width) && y < i32(view.height);
    return PatchPixel(u32(max(y, 0)) * view.width + u32(max(x, 0)), inside);
}

fn patch_corner(view: View, group: u32) -> vec2u {
    let across = (view.width + PATCH - 1u) / PATCH;
    return PATCH * vec2u(group % across, group / across);
}

fn patches(view: View) -> u32 {
    return ((view.width + PATCH - 1u) / PATCH) * ((view.height + PATCH - 1u) / PATCH);
}

section photograph
// The photograph's pixel from `photographs`, which the pass binds: RGB in [0, 1] from 8 bits each, and in the fourth
// whether it counts. What lies outside a mask counts as if the photograph showed what was rendered there.
fn photograph_at(pixel: u32) -> vec4f {
    return unpack4x8unorm(photographs[view.photograph + pixel]);
}
