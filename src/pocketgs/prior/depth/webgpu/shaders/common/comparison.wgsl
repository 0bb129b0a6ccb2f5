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
}
