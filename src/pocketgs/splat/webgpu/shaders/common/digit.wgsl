// Words of a sort's `digit`, all 0 before: the lowest bit of the digit that is counted next, and of the one whose keys
// have been given their places. They stay on the GPU, so that one pipeline serves for every digit.
const COUNTED: u32 = 0u;
const PLACED: u32 = 1u;
