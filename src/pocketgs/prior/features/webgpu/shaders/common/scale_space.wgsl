// A photograph's scale space, one octave in each buffer: LAYERS + 3 images, one after the other, each blurred more than
// the one before. Octave 0 has twice the photograph's width and height, each further one half of the one before.
struct Image {
    // Of the photograph.
    width: u32,
    height: u32,
    // Room for keypoints and for features.
    keypoint_room: u32,
    feature_room: u32,
    // Features to describe.
    chosen: u32,
    // That is worked on.
    octave: u32,
}

fn octave_width() -> u32 {
    return (2u * image.width) >> image.octave;
}

fn octave_height() -> u32 {
    return (2u * image.height) >> image.octave;
}

fn octave_pixels() -> u32 {
    return octave_width() * octave_height();
}

section gradient
// The gradient at a pixel that is not at the border: its angle from 0 to 2 pi, counted against the rows, and its length.
fn gradient(place: u32) -> vec2f {
    let width = octave_width();
    let right = scale_space[place + 1u] - scale_space[place - 1u];
    let up = scale_space[place - width] - scale_space[place + width];
    if (right == 0.0 && up == 0.0) {
        return vec2f();
    }
    let angle = atan2(up, right);
    return vec2f(select(angle, angle + TURN, angle < 0.0), sqrt(right * right + up * up));
}
