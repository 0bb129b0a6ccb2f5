// A feature, or a keypoint that has no direction yet.
struct Feature {
    // In pixels of its octave, whole numbers at their middles.
    x: f32,
    y: f32,
    // Blur, in pixels of its octave.
    scale: f32,
    // How much it stands out: the difference of Gaussians, of grey levels from 0 to 1.
    response: f32,
    // Of the strongest gradients around it, from 0 to 2 pi.
    angle: f32,
    octave: u32,
    layer: u32,
    padding: u32,
}
