// The photometric loss by patch, and its gradient with respect to the image: L2, or L1 and what `dssim` left (its
// windows' adjoint); and, where it is learned, with respect to the photograph's colour transform. One workgroup a patch
// of 16 x 16 pixels.
import view, update, patches.photograph, colours.apply, colours.adjoint, workgroups, workgroups.sum

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> update: Update;
@group(0) @binding(2) var<storage, read> image: array<vec4f>;
@group(0) @binding(3) var<storage, read> photographs: array<u32>;
@group(0) @binding(4) var<storage, read> ssim_derivatives: array<f32>;
@group(0) @binding(5) var<storage, read_write> d_image: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> loss_parts: array<vec2f>;
@group(0) @binding(7) var<storage, read> colours: array<f32>;
@group(0) @binding(8) var<storage, read_write> colour_parts: array<f32>;

// One channel's three derivatives on the patch; and filtered along the rows. (A vec3f would take the room of four.)
var<workgroup> values: array<array<f32, 3>, PADDED_PIXELS>;
var<workgroup> strip: array<array<f32, 3>, STRIP_PIXELS>;

fn as_vector(values: array<f32, 3>) -> vec3f {
    return vec3f(values[0], values[1], values[2]);
}

// The adjoint of the windowed mean, of one channel's three derivatives, at this thread's pixel.
fn spread(corner: vec2u, channel: u32, thread: u32) -> vec3f {
    let pixels = view.width * view.height;
    workgroupBarrier();
    for (var place = thread; place < PADDED_PIXELS; place += THREADS) {
        let pixel = patch_pixel(view, corner, place);
        var derivatives = array<f32, 3>();
        if (pixel.inside) {
            let first = 3u * channel * pixels + pixel.index;
            derivatives = array<f32, 3>(
                ssim_derivatives[first],
                ssim_derivatives[first + pixels],
                ssim_derivatives[first + 2u * pixels],
            );
        }
        values[place] = derivatives;
    }
    workgroupBarrier();
    for (var place = thread; place < STRIP_PIXELS; place += THREADS) {
        var sums = vec3f();
        for (var k = 0u; k < WINDOW; k++) {
            sums += SSIM_WEIGHTS[k] * as_vector(values[place / PATCH * PADDED + place % PATCH + k]);
        }
        strip[place] = array<f32, 3>(sums.x, sums.y, sums.z);
    }
    workgroupBarrier();
    var sums = vec3f();
    for (var k = 0u; k < WINDOW; k++) {
        sums += SSIM_WEIGHTS[k] * as_vector(strip[thread + k * PATCH]);
    }
    return sums;
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
    let place = corner + vec2u(thread % PATCH, thread / PATCH);
    let inside = place.x < view.width && place.y < view.height;
    let pixel = place.y * view.width + place.x;
    var rendered = vec3f();
    var photo = vec4f();
    if (inside) {
        rendered = image[pixel].rgb;
        photo = photograph_at(pixel);
    }
    let x = in_photograph(rendered);
    let counts = photo.a > 0.5;
    let y = select(x, photo.rgb, counts);
    let difference = x - y;
    let error = update.absolute_weight * abs(difference) + update.squared_weight * difference * difference;
    var gradient = update.absolute_weight * sign(difference) + 2.0 * update.squared_weight * difference;
    if (update.structural_weight > 0.0) {
        for (var channel = 0u; channel < 3u; channel++) {
            let d = spread(corner, channel, thread);
            gradient[channel] -= update.structural_weight * (d.x + 2.0 * x[channel] * d.y + y[channel] * d.z);
        }
    }
    gradient = select(vec3f(), gradient, counts);
    if (inside) {
        d_image[pixel] = vec4f(to_rendering(gradient), 0.0);
    }
    if (update.colours_learned == 1u) {
        // The transform's numbers by rows: what multiplies red, green and blue, and what is added.
        let factors = vec4f(rendered, 1.0);
        for (var number = 0u; number < 12u; number++) {
            let part = workgroup_sum(gradient[number / 4u] * factors[number % 4u], thread);
            if (thread == 0u) {
                colour_parts[12u * group + number] = part;
            }
        }
    }
    let sum = workgroup_sum(error.r + error.g + error.b, thread);
    if (thread == 0u) {
        loss_parts[group].x = sum;
    }
}
