// Windows of SSIM are taken by a workgroup of 16 x 16 pixels from a patch with a margin of half a window around it.
const SIDE: u32 = 16u;
const MARGIN: u32 = 5u;
const PATCH: u32 = 26u;
const PATCH_PIXELS: u32 = 676u;
// The patch, filtered along its rows.
const STRIP_PIXELS: u32 = 416u;

// Row-major index of a pixel of the image, for a place of the patch; false outside the image.
struct PatchPixel {
    index: u32,
    inside: bool,
}

fn patch_pixel(view: View, corner: vec2u, place: u32) -> PatchPixel {
    let x = i32(corner.x + place % PATCH) - i32(MARGIN);
    let y = i32(corner.y + place / PATCH) - i32(MARGIN);
    let inside = x >= 0 && y >= 0 && x < i32(view.width) && y < i32(view.height);
    return PatchPixel(u32(max(y, 0)) * view.width + u32(max(x, 0)), inside);
}

fn patch_corner(view: View, group: u32) -> vec2u {
    let across = (view.width + SIDE - 1u) / SIDE;
    return SIDE * vec2u(group % across, group / across);
}

fn patches(view: View) -> u32 {
    return ((view.width + SIDE - 1u) / SIDE) * ((view.height + SIDE - 1u) / SIDE);
}
