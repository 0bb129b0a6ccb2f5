// Places beyond the ends of a line, as OpenCV's BORDER_REFLECT_101: mirrored at both ends without repeating them.
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
