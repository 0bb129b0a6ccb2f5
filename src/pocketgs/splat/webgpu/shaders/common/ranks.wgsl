// What stands at a rank, a Gaussian's place in the order of depth. Gaussians of clusters outside the view have none.
//
// Words of `intersection_count`: how many intersections there are, and how many ranks; both 0 while the run is halted.
const INTERSECTIONS: u32 = 0u;
const RANKS: u32 = 1u;

section slots
import ranks
// First and one past the last of a rank's slots, one for every tile that it reaches; the same twice where it reaches
// none.
fn slots_at(rank: u32) -> vec2u {
    if (rank >= intersection_count[RANKS]) {
        return vec2u();
    }
    return vec2u(first_slots[rank], first_slots[rank + 1u]);
}
