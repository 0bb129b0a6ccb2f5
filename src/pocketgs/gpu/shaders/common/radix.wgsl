// A radix sort, least significant digit first; a workgroup takes a block of BLOCK keys.
const DIGITS: u32 = 1u << DIGIT_BITS;
const KEYS_PER_THREAD: u32 = BLOCK / THREADS;

fn digit_of(key: u32, shift: u32) -> u32 {
    return (key >> shift) & (DIGITS - 1u);
}

// Words of a sort's `digit`, all 0 before: the lowest bit of the digit that is counted next, and of the one whose keys
// have been given their places. They stay on the GPU, so that one pipeline serves for every digit.
const COUNTED: u32 = 0u;
const PLACED: u32 = 1u;
