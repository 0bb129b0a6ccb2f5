// Composite each tile's splats in the order of its list: front to back (3DGS, equation 3), or in any order. One
// workgroup per tile and group of three channels, one thread per pixel.
import view, splats.read, tiles, compositor.forward, channels.kind, weights.finished, replay.record, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> tile_starts: array<u32>;
@group(0) @binding(2) var<storage, read> sorted_slots: array<u32>;
@group(0) @binding(3) var<storage, read> slot_splats: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<u32>;
@group(0) @binding(5) var<storage, read_write> image: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> drawn_ranges: array<vec2u>;

// Draw depths in place of colours.
override draw_depth: bool = false;

var<workgroup> batch: array<Splat, TILE_PIXELS>;
var<workgroup> drawn_end: atomic<u32>;
var<workgroup> clear_pixels: atomic<u32>;
var<workgroup> finished: u32;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_id) place: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let tiles = view.tiles_across * view.tiles_down;
    let number = view.first_tile + folded(workgroup);
    let tile = number % tiles;
    let group = number / tiles;
    if (group >= view.channel_groups) {
        return;
    }
    let pixel = tile_origin(view, tile) + place.xy;
    let inside = pixel.x < view.width && pixel.y < view.height;
    let index = pixel.y * view.width + pixel.x;
    let centre = vec2f(pixel) + 0.5;
    let first = tile_starts[tile];
    let end = tile_starts[tile + 1u];

    // WGSL has workgroup memory begin at 0, but not every driver keeps to it.
    if (thread == 0u) {
        atomicStore(&drawn_end, 0u);
        atomicStore(&clear_pixels, 0u);
    }
    workgroupBarrier();
    var gathered = nothing_yet(inside);
    var contributions = 0u;
    var last = first;
    for (var start = first; start < end; start += TILE_PIXELS) {
        if (start + thread < end) {
            let gaussian = slot_splats[sorted_slots[start + thread]];
            batch[thread] = read_splat(gaussian);
            batch[thread].colour = shown(batch[thread], gaussian, group);
            batch[thread].weight = finished_weight(batch[thread].weight);
        }
        workgroupBarrier();
        for (var k = 0u; k < min(TILE_PIXELS, end - start); k++) {
            let splat = batch[k];
            let alpha = alpha_at(exponent_at(splat, centre - splat.mean), gathered.a);
            if (alpha > 0.0) {
                let colour = select(splat.colour, vec3f(splat.depth), draw_depth);
                gathered = with_splat(gathered, alpha, colour, splat.weight);
                last = start + k + 1u;
                remember(index, contributions, start + k, alpha, gathered.rgb);
                contributions++;
            }
        }
        // The tile is finished once no pixel takes any more.
        if (takes_more(gathered)) {
            atomicAdd(&clear_pixels, 1u);
        }
        workgroupBarrier();
        if (thread == 0u) {
            finished = u32(atomicExchange(&clear_pixels, 0u) == 0u);
        }
        if (workgroupUniformLoad(&finished) == 1u) {
            break;
        }
    }
    atomicMax(&drawn_end, last);
    workgroupBarrier();
    if (thread == 0u && group == 0u) {
        drawn_ranges[tile] = vec2u(first, max(first, atomicLoad(&drawn_end)));
    }
    if (inside) {
        image[group * view.width * view.height + index] = composited(gathered);
        remember_count(index, contributions);
    }
}
