// 32 well-mixed bits of 32 bits (the output function of PCG, Jarzynski and Olano 2020).
fn pcg_hash(word: u32) -> u32 {
    let state = word * 747796405u + 2891336453u;
    let mixed = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (mixed >> 22u) ^ mixed;
}
