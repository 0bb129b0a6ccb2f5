// The gradient of the image by replaying each tile front to back. One workgroup per tile.
import view, ring, compositor.backward, replay.source, gradient_rows.add, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> drawn_ranges: array<vec2u>;
@group(0) @binding(2) var<storage, read> sorted_slots: array<u32>;
@group(0) @binding(3) var<storage, read> slot_splats: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<u32>;
@group(0) @binding(5) var<storage, read> image: array<vec4f>;
@group(0) @binding(6) var<storage, read> d_image: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> gradient_rows: array<GradientWord>;

// The pixels of the tile: T, H, and the gradient of their colours.
var<workgroup> transmittances: array<f32, TILE_PIXELS>;
var<workgroup> behind: array<f32, TILE_PIXELS>;
var<workgroup> d_colours: array<vec3f, TILE_PIXELS>;

alias Sums = SplatSums;

fn load_pixel(tile: u32, thread: u32) {
    let pixel = tile_origin(view, tile) + vec2u(thread % TILE, thread / TILE);
    let inside = pixel.x < view.width && pixel.y < view.height;
    let index = pixel.y * view.width + pixel.x;
    var d_pixel = vec4f();
    var finished = vec4f();
    if (inside) {
        finished = image[index];
        d_pixel = d_image[index];
        begin_replay(thread, index);
    }
    // A pixel outside the image takes no contribution.
    transmittances[thread] = select(0.0, 1.0, inside);
    behind[thread] = first_behind(finished, d_pixel);
    d_colours[thread] = d_pixel.rgb;
}

// A splat's α at a pixel, and H behind it; see the file that implements `replay`.
struct Contribution {
    alpha: f32,
    rest: f32,
}

fn visit(held: Held, pixel: u32, centre: vec2f, sums: ptr<function, Sums>) {
    let splat = held.splat;
    let offset = centre - splat.mean;
    let transmittance = transmittances[pixel];
    let d_colour = d_colours[pixel];
    let contribution = replay(splat, held.intersection, pixel, offset, transmittance, d_colour);
    let alpha = contribution.alpha;
    if (alpha == 0.0) {
        return;
    }
    let weight = alpha * transmittance;
    transmittances[pixel] = transmittance - weight;
    behind[pixel] = contribution.rest;
    let v = d_log_alpha(weight * dot(splat.colour, d_colour), contribution.rest, alpha);
    (*sums).exponent += v;
    (*sums).offset += v * offset;
    (*sums).square += v * vec3f(offset.x * offset.x, offset.x * offset.y, offset.y * offset.y);
    (*sums).colour += weight * d_colour;
}

fn leave(held: Held, sums: Sums) {
    accumulate(held.slot, held.gaussian, sums);
}

@compute @workgroup_size(TILE_PIXELS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let tile = folded(workgroup);
    if (tile >= view.tiles_across * view.tiles_down) {
        return;
    }
    load_pixel(tile, thread);
    workgroupBarrier();
    replay_tile(tile, drawn_ranges[tile], thread);
}
