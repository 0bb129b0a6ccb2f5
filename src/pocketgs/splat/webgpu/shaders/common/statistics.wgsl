// Columns of `statistics`: by Gaussian, what is summed up over the steps for strategies to decide by.
const SCREEN_GRADIENT: u32 = 0u;
const SEEN: u32 = 1u;
const RADIUS: u32 = 2u;
const ERROR: u32 = 3u;
