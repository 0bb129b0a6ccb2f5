// Points, and a binary tree of boxes around those that follow each other in memory. Box 1 holds all; the halves of box n
// are boxes 2n and 2n + 1; box `leaves` + i holds the points from LEAF * i on.
struct Cloud {
    points: u32,
    // How many nearest points each has, itself included.
    neighbours: u32,
    // A power of 2; the last ones may be empty.
    leaves: u32,
}

struct Box {
    low: vec3f,
    high: vec3f,
}

// Farther than any two points, whose coordinates lie between -1 and 1.
const FAR: f32 = 1e9;

section points
// The points, which the pass binds as `positions`.
fn position(point: u32) -> vec3f {
    return vec3f(positions[3u * point], positions[3u * point + 1u], positions[3u * point + 2u]);
}
