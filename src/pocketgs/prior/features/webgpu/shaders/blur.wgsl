// Blur an image by a Gaussian along its rows or columns, mirrored at the border. One thread per pixel.
import scale_space, mirrored, workgroups

@group(0) @binding(0) var<uniform> image: Image;
@group(0) @binding(1) var<storage, read> sharp: array<f32>;
@group(0) @binding(2) var<storage, read> kernels: array<f32>;
@group(0) @binding(3) var<storage, read_write> blurred: array<f32>;

override sharp_layer: u32 = 0u;
override blurred_layer: u32 = 0u;
// Where the kernel begins, from its middle on, and how far it reaches.
override kernel: u32 = 0u;
override radius: i32 = 0;
// 1 to blur along columns.
override is_down: u32 = 0u;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixels = octave_pixels();
    let pixel = folded(workgroup) * THREADS + thread;
    if (pixel >= pixels) {
        return;
    }
    let width = octave_width();
    let stride = select(1u, width, is_down == 1u);
    let length = i32(select(width, octave_height(), is_down == 1u));
    let place = i32(select(pixel % width, pixel / width, is_down == 1u));
    let line = sharp_layer * pixels + select(pixel - pixel % width, pixel % width, is_down == 1u);
    let is_inside = place >= radius && place + radius < length;
    var sum = kernels[kernel] * sharp[line + u32(place) * stride];
    for (var tap = 1; tap <= radius; tap++) {
        var before = u32(max(place - tap, 0));
        var after = u32(place + tap);
        if (!is_inside) {
            before = mirrored(place - tap, length);
            after = mirrored(place + tap, length);
        }
        sum += kernels[kernel + u32(tap)] * (sharp[line + before * stride] + sharp[line + after * stride]);
    }
    blurred[blurred_layer * pixels + pixel] = sum;
}
