// One view whose depths are compared with the other views'. Written anew for every view.
struct Comparison {
    // Of the view, in pixels.
    focal: vec2f,
    principal: vec2f,
    width: u32,
    height: u32,
    // What all depth maps are padded to.
    image_width: u32,
    image_height: u32,
    // Its index among the views, and how many there are.
    view: u32,
    views: u32,
    // Greatest relative difference of depths that agree.
    tolerance: f32,
    // Least confidence outside holes.
    least: f32,
}

section votes
// Agreeing views in the lower half of a word, contradicting ones in the upper.
fn agreeing_of(word: u32) -> u32 {
    return word & 65535u;
}

fn contradicting_of(word: u32) -> u32 {
    return word >> 16u;
}

section window
const REACH: i32 = i32(HOLE / 2u);
