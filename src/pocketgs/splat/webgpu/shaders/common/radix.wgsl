// A radix sort by digits of 4 bits, least significant first; a workgroup of 256 threads takes a block of 2048 keys.
const DIGITS: u32 = 16u;
const THREADS: u32 = 256u;
const KEYS_PER_THREAD: u32 = 8u;
const BLOCK: u32 = 2048u;

fn digit_of(key: u32, shift: u32) -> u32 {
    return (key >> shift) & (DIGITS - 1u);
}
