// SSIM over whole windows (Wang et al. 2004, equation 13): its sum by patch, and its derivatives with respect to the
// windowed means of x, of x² + y² and of xy. One workgroup per patch of 16 x 16 window centres.
import view, update, patches.photograph, colours.apply, workgroups, workgroups.sum

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> update: Update;
@group(0) @binding(2) var<storage, read> image: array<vec4f>;
@group(0) @binding(3) var<storage, read> photographs: array<u32>;
@group(0) @binding(4) var<storage, read_write> ssim_derivatives: array<f32>;
@group(0) @binding(5) var<storage, read_write> loss_parts: array<vec2f>;
@group(0) @binding(6) var<storage, read> colours: array<f32>;

// Rendered and photographed value of one channel; and the windowed means of x, y, x² + y² and xy along the rows.
var<workgroup> values: array<vec2f, PADDED_PIXELS>;
var<workgroup> strip: array<vec4f, STRIP_PIXELS>;

fn load_patch(corner: vec2u, channel: u32, thread: u32) {
    for (var place = thread; place < PADDED_PIXELS; place += THREADS) {
        let pixel = patch_pixel(view, corner, place);
        var pair = vec2f();
        if (pixel.inside) {
            let x = in_photograph(image[pixel.index].rgb)[channel];
            let photo = photograph_at(pixel.index);
            pair = vec2f(x, select(x, photo[channel], photo.a > 0.5));
        }
        values[place] = pair;
    }
}

fn filter_rows(thread: u32) {
    for (var place = thread; place < STRIP_PIXELS; place += THREADS) {
        var sums = vec4f();
        for (var k = 0u; k < WINDOW; k++) {
            let v = values[place / PATCH * PADDED + place % PATCH + k];
            sums += SSIM_WEIGHTS[k] * vec4f(v, dot(v, v), v.x * v.y);
        }
        strip[place] = sums;
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let group = folded(workgroup);
    if (group >= patches(view)) {
        return;
    }
    let corner = patch_corner(view, group);
    let centre = corner + vec2u(thread % PATCH, thread / PATCH);
    let inside = centre.x < view.width && centre.y < view.height;
    let whole = all(centre >= vec2u(MARGIN)) && all(centre + MARGIN < vec2u(view.width, view.height));
    let pixels = view.width * view.height;
    var similarities = 0.0;
    for (var channel = 0u; channel < 3u; channel++) {
        workgroupBarrier();
        load_patch(corner, channel, thread);
        workgroupBarrier();
        filter_rows(thread);
        workgroupBarrier();
        var means = vec4f();
        for (var k = 0u; k < WINDOW; k++) {
            means += SSIM_WEIGHTS[k] * strip[thread + k * PATCH];
        }
        let x = means.x;
        let y = means.y;
        let luminance = 2.0 * x * y + SSIM_C1;
        let luminance_bound = x * x + y * y + SSIM_C1;
        let structure = 2.0 * (means.w - x * y) + SSIM_C2;
        let structure_bound = max(means.z - x * x - y * y, 0.0) + SSIM_C2;
        let similarity = luminance * structure / (luminance_bound * structure_bound);
        let d_square = -similarity / structure_bound;
        let d_product = 2.0 * luminance / (luminance_bound * structure_bound);
        let d_mean = 2.0 * similarity * (y / luminance - x / luminance_bound) - 2.0 * x * d_square - y * d_product;
        if (inside) {
            let place = 3u * channel * pixels + centre.y * view.width + centre.x;
            ssim_derivatives[place] = select(0.0, d_mean, whole);
            ssim_derivatives[place + pixels] = select(0.0, d_square, whole);
            ssim_derivatives[place + 2u * pixels] = select(0.0, d_product, whole);
        }
        similarities += select(0.0, similarity, whole);
    }
    let sum = workgroup_sum(similarities, thread);
    if (thread == 0u) {
        loss_parts[group].y = sum;
    }
}
