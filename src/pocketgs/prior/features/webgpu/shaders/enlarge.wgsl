// The photograph at twice its size, interpolated, written where layer 1 will stand. One thread per pixel.
import scale_space, workgroups

@group(0) @binding(0) var<uniform> image: Image;
@group(0) @binding(1) var<storage, read> grey: array<f32>;
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
    // Even pixels lie on those of the photograph, odd ones between two; the last row and column are repeated.
    let x = pixel % octave_width();
    let y = pixel / octave_width();
    let right = min((x + 1u) / 2u, image.width - 1u);
    let below = min((y + 1u) / 2u, image.height - 1u);
    let row = y / 2u * image.width;
    let next = below * image.width;
    let sum = grey[row + x / 2u] + grey[row + right] + grey[next + x / 2u] + grey[next + right];
    scale_space[octave_pixels() + pixel] = 0.25 * sum;
}
