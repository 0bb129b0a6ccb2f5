// The keys that Gaussians are sorted by, nearest first.

section written
// The bits of a depth, which sort as the depth does.
@group(0) @binding(8) var<storage, read_write> depth_keys: array<u32>;

// The key of what is not drawn: greater than any depth's.
const CULLED: u32 = 0xffffffffu;

fn leave_out(place: u32) {
    depth_keys[place] = CULLED;
}

fn enter(place: u32, depth: f32) {
    depth_keys[place] = bitcast<u32>(depth);
}

section none
// Where nothing is sorted there are none.
fn leave_out(place: u32) {
}

fn enter(place: u32, depth: f32) {
}
