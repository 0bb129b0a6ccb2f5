// Put a view's error, the mean of its channels, in place of the red gradient of each pixel: the backward pass then sums
// up by splat α T times the error. One thread per pixel.
import view, update, patches.photograph, colours.apply, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> image: array<vec4f>;
@group(0) @binding(2) var<storage, read> photographs: array<u32>;
@group(0) @binding(3) var<storage, read_write> d_image: array<vec4f>;
@group(0) @binding(4) var<uniform> update: Update;
@group(0) @binding(5) var<storage, read> colours: array<f32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = folded(workgroup) * THREADS + thread;
    if (pixel >= view.width * view.height) {
        return;
    }
    let photo = photograph_at(pixel);
    let difference = abs(in_photograph(image[pixel].rgb) - photo.rgb);
    let error = select(0.0, (difference.r + difference.g + difference.b) / 3.0, photo.a > 0.5);
    d_image[pixel] = vec4f(error, 0.0, 0.0, 0.0);
}
