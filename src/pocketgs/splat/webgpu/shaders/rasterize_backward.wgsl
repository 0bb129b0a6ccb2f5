// The gradient of the image by replaying each tile front to back: a ring of threads, each holding one splat, through
// which the pixels pass. One workgroup per tile.
//
// With D_i = c_i · ∂L/∂C, what lies behind splat i enters its gradient only through the number
// H_i = Σ_{j>i} w_j D_j + T background · ∂L/∂C, which starts at C · ∂L/∂C and loses w_i D_i at every contribution. A
// pixel's T and H are all that a replay carries from one splat to the next. So thread t takes its splat to pixel p at
// step t + p, just after thread t - 1 has taken its own there; after 64 pixels it takes up the splat 64 places on. A
// splat's sums over the pixels stay in its thread's registers, and no thread adds to another's.
import view, splats.read, tiles, compositing, replay.source, gradient_rows.add, workgroups

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

fn load_pixel(tile: u32, thread: u32) {
    let pixel = tile_origin(view, tile) + vec2u(thread % TILE, thread / TILE);
    var colour = vec3f();
    var d_colour = vec3f();
    let inside = pixel.x < view.width && pixel.y < view.height;
    let index = pixel.y * view.width + pixel.x;
    if (inside) {
        colour = image[index].rgb;
        d_colour = d_image[index].rgb;
        begin_replay(thread, index);
    }
    // A pixel outside the image takes no contribution.
    transmittances[thread] = select(0.0, 1.0, inside);
    behind[thread] = dot(colour, d_colour);
    d_colours[thread] = d_colour;
}

// A splat's α at a pixel, and H behind it; see the file that implements `replay`.
struct Contribution {
    alpha: f32,
    rest: f32,
}

// Take a splat to a pixel of the tile.
fn visit(splat: Splat, intersection: u32, pixel: u32, centre: vec2f, sums: ptr<function, SplatSums>) {
    let offset = centre - splat.mean;
    let transmittance = transmittances[pixel];
    let d_colour = d_colours[pixel];
    let contribution = replay(splat, intersection, pixel, offset, transmittance, d_colour);
    let alpha = contribution.alpha;
    if (alpha == 0.0) {
        return;
    }
    let weight = alpha * transmittance;
    let gain = weight * dot(splat.colour, d_colour);
    let rest = contribution.rest;
    transmittances[pixel] = transmittance - weight;
    behind[pixel] = rest;
    // ∂L/∂(ln α) = α ∂L/∂α = α (T D - H / (1 - α)); α is flat where it is clamped.
    let v = select(0.0, gain - rest * (alpha / (1.0 - alpha)), alpha < ALPHA_MAX);
    (*sums).exponent += v;
    (*sums).offset += v * offset;
    (*sums).square += v * vec3f(offset.x * offset.x, offset.x * offset.y, offset.y * offset.y);
    (*sums).colour += weight * d_colour;
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
    let first = drawn_ranges[tile].x;
    let end = drawn_ranges[tile].y;
    if (first == end) {
        return;
    }
    let origin = vec2f(tile_origin(view, tile)) + 0.5;
    let rounds = (end - first + TILE_PIXELS - 1u) / TILE_PIXELS;
    // The splat in hand, and the next one, which all threads fetch together.
    var splat: Splat;
    var next: Splat;
    var intersection = end;
    var next_intersection = end;
    var sums: SplatSums;
    for (var step = 0u; step < (rounds + 1u) * TILE_PIXELS - 1u; step++) {
        if (step % TILE_PIXELS == 0u) {
            next_intersection = first + step + thread;
            if (next_intersection < end) {
                next = read_splat(slot_splats[sorted_slots[next_intersection]]);
            }
        }
        let pixel = (step - thread) % TILE_PIXELS;
        if (step >= thread && pixel == 0u) {
            splat = next;
            intersection = next_intersection;
            sums = SplatSums();
        }
        if (step >= thread && intersection < end) {
            visit(splat, intersection, pixel, origin + vec2f(f32(pixel % TILE), f32(pixel / TILE)), &sums);
            if (pixel == TILE_PIXELS - 1u) {
                let slot = sorted_slots[intersection];
                accumulate(slot, slot_splats[slot], sums);
            }
        }
        workgroupBarrier();
    }
}
