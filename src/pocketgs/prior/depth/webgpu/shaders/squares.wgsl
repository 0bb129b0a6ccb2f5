// For every pixel of the source views the grey levels of four, one byte each: its own, its right neighbour's and the
// two below. One read then gives all that is interpolated between. Border pixels are repeated. One thread per pixel.
import sweep, photographs, workgroups

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<storage, read> photographs: array<u32>;
@group(0) @binding(2) var<storage, read> sources: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> squares: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = folded(workgroup) * THREADS + thread;
    let pixels = sweep.image_width * sweep.image_height;
    let source = index / pixels;
    if (source >= sweep.sources) {
        return;
    }
    let size = vec2u(sources[4u * source + 3u].xy);
    let x = index % pixels % sweep.image_width;
    let y = index % pixels / sweep.image_width;
    if (x >= size.x || y >= size.y) {
        return;
    }
    let first = (source + 1u) * pixels;
    let above = first + y * sweep.image_width;
    let below = first + min(y + 1u, size.y - 1u) * sweep.image_width;
    let right = min(x + 1u, size.x - 1u);
    squares[index] = grey_of(photographs[above + x])
        | (grey_of(photographs[above + right]) << 8u)
        | (grey_of(photographs[below + x]) << 16u)
        | (grey_of(photographs[below + right]) << 24u);
}
