// `rasterize_backward` for any number of channels: what is held by channel stays in memory, where only the thread that
// has the splat in hand touches it. `gradient_rows` is all 0 before. One workgroup per tile.
import view, ring, compositor.backward, channels.groups, channel_rows, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> drawn_ranges: array<vec2u>;
@group(0) @binding(2) var<storage, read> sorted_slots: array<u32>;
@group(0) @binding(3) var<storage, read> slot_splats: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<u32>;
@group(0) @binding(5) var<storage, read> image: array<vec4f>;
@group(0) @binding(6) var<storage, read> d_image: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> gradient_rows: array<f32>;

// Sum up the magnitudes of the pixels' gradients with respect to the splat's centre too.
override absolute: bool = false;

// The pixels of the tile: T, H, and their place in the image.
var<workgroup> transmittances: array<f32, TILE_PIXELS>;
var<workgroup> behind: array<f32, TILE_PIXELS>;
var<workgroup> places: array<u32, TILE_PIXELS>;

struct Sums {
    shape: SplatSums,
    absolute: vec2f,
}

fn load_pixel(tile: u32, thread: u32) {
    let pixel = tile_origin(view, tile) + vec2u(thread % TILE, thread / TILE);
    let inside = pixel.x < view.width && pixel.y < view.height;
    let place = pixel.y * view.width + pixel.x;
    places[thread] = place;
    // A pixel outside the image takes no contribution.
    transmittances[thread] = select(-1.0, 1.0, inside);
    var rest = 0.0;
    if (inside) {
        for (var group = 0u; group < view.channel_groups; group++) {
            let index = group * view.width * view.height + place;
            rest += first_behind(image[index], d_image[index]);
        }
    }
    behind[thread] = rest;
}

fn visit(held: Held, pixel: u32, centre: vec2f, sums: ptr<function, Sums>) {
    let splat = held.splat;
    let offset = centre - splat.mean;
    let transmittance = transmittances[pixel];
    let alpha = alpha_at(exponent_at(splat, offset), transmittance);
    if (alpha == 0.0) {
        return;
    }
    let weight = weight_of(alpha, transmittance);
    transmittances[pixel] = transmittance_behind(transmittance, weight);
    if (weight < 0.0) {
        return;
    }
    let row = channel_row(held.slot) + SHAPE_WORDS;
    var gain = 0.0;
    for (var group = 0u; group < view.channel_groups; group++) {
        let d_values = d_image[group * view.width * view.height + places[pixel]].rgb;
        gain += weight * dot(shown(splat, held.gaussian, group), d_values);
        for (var channel = 0u; channel < 3u; channel++) {
            gradient_rows[row + 3u * group + channel] += weight * d_values[channel];
        }
    }
    let rest = rest_behind(behind[pixel], gain);
    behind[pixel] = rest;
    let v = d_log_alpha(gain, rest, alpha);
    (*sums).shape.exponent += v;
    (*sums).shape.offset += v * offset;
    (*sums).shape.square += v * vec3f(offset.x * offset.x, offset.x * offset.y, offset.y * offset.y);
    if (absolute) {
        (*sums).absolute += abs(v * (inverse_covariance(splat) * offset));
    }
}

fn leave(held: Held, sums: Sums) {
    let row = channel_row(held.slot);
    let words = sum_words(sums.shape);
    for (var w = 0u; w < ABSOLUTE_WORD; w++) {
        gradient_rows[row + w] = words[w];
    }
    gradient_rows[row + ABSOLUTE_WORD] = sums.absolute.x;
    gradient_rows[row + ABSOLUTE_WORD + 1u] = sums.absolute.y;
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
