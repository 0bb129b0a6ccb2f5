// A radix sort, least significant digit first; a workgroup takes a block of BLOCK keys.
const DIGITS: u32 = 1u << DIGIT_BITS;
const KEYS_PER_THREAD: u32 = BLOCK / THREADS;

fn digit_of(key: u32, shift: u32) -> u32 {
    return (key >> shift) & (DIGITS - 1u);
}
