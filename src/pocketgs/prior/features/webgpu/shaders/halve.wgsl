// The first image of an octave: every other pixel of that image of the octave before which is blurred twice as much as
// its first. One thread per pixel.
import scale_space, workgroups

@group(0) @binding(0) var<uniform> image: Image;
@group(0) @binding(1) var<storage, read> before: array<f32>;
@group(0) @binding(2) var<storage, read_write> scale_space: array<f32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = folded(workgroup) * THREADS + thread;
    if (pixel >= octave_pixels()) {
        return;
    }
    let width = (2u * image.width) >> (image.octave - 1u);
    let height = (2u * image.height) >> (image.octave - 1u);
    let x = 2u * (pixel % octave_width());
    let y = 2u * (pixel / octave_width());
    scale_space[pixel] = before[LAYERS * width * height + y * width + x];
}
