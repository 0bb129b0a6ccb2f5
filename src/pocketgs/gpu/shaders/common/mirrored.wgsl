// Places beyond the ends of a line, mirrored at both ends. Remainders of negative numbers would be shorter, but Vulkan
// leaves them undefined, and NVIDIA's are wrong.

// The ends are not repeated: OpenCV's BORDER_REFLECT_101.
fn mirrored(index: i32, length: i32) -> u32 {
    if (length == 1) {
        return 0u;
    }
    var place = index;
    while (place < 0 || place >= length) {
        place = select(-place, 2 * length - 2 - place, place >= length);
    }
    return u32(place);
}

// The ends are repeated: BORDER_REFLECT.
fn mirrored_with_ends(index: i32, length: i32) -> u32 {
    var place = index;
    while (place < 0 || place >= length) {
        place = select(-1 - place, 2 * length - 1 - place, place >= length);
    }
    return u32(place);
}
