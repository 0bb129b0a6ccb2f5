// What stands at a rank, a Gaussian's place in the order of depth.

// First and one past the last of its slots, one for every tile that it reaches; the same twice where it reaches none, and
// while the run is halted.
fn slots_at(rank: u32) -> vec2u {
    if (rank >= view.gaussians || intersection_count[0] == 0u) {
        return vec2u();
    }
    return vec2u(first_slots[rank], first_slots[rank + 1u]);
}
