// Words of `status`, which outlives the image: how many steps have been completed; whether a step needed more room for
// entries than there is, after which nothing happens until the host has made room; and how many entries it needed.
const STEPS: u32 = 0u;
const HALTED: u32 = 1u;
const NEEDED: u32 = 2u;
