/**
 * Shaders that draw a rendered image to the canvas.
 *
 * @module
 */

/** Depths are counted by their logarithm: bins of 1/16 octave from the near plane on. */
const HISTOGRAM = /* wgsl */ `
const BINS: u32 = 256u;
const BINS_PER_OCTAVE: f32 = 16.0;
`;

/** What is to be drawn, and what its pixels mean. */
const DISPLAY = /* wgsl */ `
struct Display {
    background: vec4f,
    image_size: vec2u,
    canvas_size: vec2u,
    shows_depth: u32,
    near: f32,
}

@group(0) @binding(0) var<uniform> display: Display;

// A pixel of the image holds Σ α T depth and, as the fourth number, the transmittance.
fn opacity_of(pixel: vec4f) -> f32 {
    return 1.0 - pixel.a;
}

// In octaves beyond the near plane, which follows the scene's unit of length.
fn log_depth_of(pixel: vec4f) -> f32 {
    return log2(max(pixel.r / max(opacity_of(pixel), 1e-6) / display.near, 1.0));
}
`;

/** Counts the depths of opaque pixels. */
export const COUNT_DEPTHS = /* wgsl */ `
${HISTOGRAM}
${DISPLAY}
@group(0) @binding(1) var<storage, read> image: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> histogram: array<atomic<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) thread: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var i = thread.x; i < arrayLength(&image); i += 256u * groups.x) {
        if (opacity_of(image[i]) > 0.5) {
            let bin = log_depth_of(image[i]) * BINS_PER_OCTAVE;
            atomicAdd(&histogram[u32(min(bin, f32(BINS - 1u)))], 1u);
        }
    }
}
`;

/** Finds the 2 % and 98 % quantiles of those depths. */
export const FIND_DEPTH_RANGE = /* wgsl */ `
${HISTOGRAM}
@group(0) @binding(0) var<storage, read> histogram: array<u32>;
@group(0) @binding(1) var<storage, read_write> depth_range: vec2f;

fn quantile(share: f32, total: f32) -> f32 {
    var before = 0.0;
    for (var bin = 0u; bin < BINS; bin++) {
        let count = f32(histogram[bin]);
        if (count > 0.0 && before + count >= share * total) {
            return (f32(bin) + (share * total - before) / count) / BINS_PER_OCTAVE;
        }
        before += count;
    }
    return 0.0;
}

@compute @workgroup_size(1)
fn main() {
    var total = 0.0;
    for (var bin = 0u; bin < BINS; bin++) {
        total += f32(histogram[bin]);
    }
    depth_range = vec2f(quantile(0.02, total), quantile(0.98, total));
}
`;

/** Draws the image over the whole canvas, scaled up if it is smaller, as colours or as depths. */
export const DRAW = /* wgsl */ `
${DISPLAY}
@group(0) @binding(1) var<storage, read> image: array<vec4f>;
@group(0) @binding(2) var<storage, read> depth_range: vec2f;

@vertex
fn cover(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4f {
    return vec4f(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn pixel_at(place: vec2i) -> vec4f {
    let inside = vec2u(clamp(place, vec2i(0), vec2i(display.image_size) - 1));
    return image[inside.y * display.image_size.x + inside.x];
}

// Interpolates between four pixels, or reads one pixel if image and canvas have the same size.
fn image_at(position: vec2f) -> vec4f {
    let place = position * vec2f(display.image_size) / vec2f(display.canvas_size) - 0.5;
    let corner = vec2i(floor(place));
    let share = place - floor(place);
    let top = mix(pixel_at(corner), pixel_at(corner + vec2i(1, 0)), share.x);
    let bottom = mix(pixel_at(corner + vec2i(0, 1)), pixel_at(corner + vec2i(1, 1)), share.x);
    return mix(top, bottom, share.y);
}

// Near is bright and warm, far is dark and blue.
fn colour_of_depth(nearness: f32) -> vec3f {
    let far = mix(vec3f(0.05, 0.04, 0.16), vec3f(0.45, 0.12, 0.45), min(2.0 * nearness, 1.0));
    return mix(far, vec3f(1.0, 0.86, 0.55), max(2.0 * nearness - 1.0, 0.0));
}

@fragment
fn colour(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = image_at(position.xy);
    if (display.shows_depth == 0u) {
        return vec4f(pixel.rgb, 1.0);
    }
    let extent = max(depth_range.y - depth_range.x, 1e-3);
    let nearness = clamp((depth_range.y - log_depth_of(pixel)) / extent, 0.0, 1.0);
    return vec4f(mix(display.background.rgb, colour_of_depth(nearness), opacity_of(pixel)), 1.0);
}
`;
