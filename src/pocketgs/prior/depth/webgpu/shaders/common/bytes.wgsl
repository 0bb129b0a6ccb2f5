// Four numbers of 8 bits in a word, computed with at once (Warren, Hacker's Delight, section 2-18).
const ONES: u32 = 0x01010101u;
const HIGHEST: u32 = 0x80808080u;

// The highest bit of every byte in which a < b.
fn less(a: u32, b: u32) -> u32 {
    let no_borrow = (a | HIGHEST) - (b & ~HIGHEST);
    return ((~a & b) | ~((a ^ b) | no_borrow)) & HIGHEST;
}

// 255 in every byte whose highest bit is set, given those bits alone.
fn filled(bits: u32) -> u32 {
    return (bits >> 7u) * 255u;
}

// The bytes of a where those of the mask are 255, and of b where they are 0.
fn picked(mask: u32, a: u32, b: u32) -> u32 {
    return (a & mask) | (b & ~mask);
}
