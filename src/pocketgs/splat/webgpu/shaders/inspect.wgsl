// What each splat adds to each tile, and the median depth of each pixel, 0 where none is. One workgroup per tile.
import view, ring, compositor.inspection, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> drawn_ranges: array<vec2u>;
@group(0) @binding(2) var<storage, read> sorted_slots: array<u32>;
@group(0) @binding(3) var<storage, read> slot_splats: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<u32>;
@group(0) @binding(5) var<storage, read_write> contribution_rows: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> median_depths: array<f32>;

// The pixels of the tile: T, and the median depth.
var<workgroup> transmittances: array<f32, TILE_PIXELS>;
var<workgroup> medians: array<f32, TILE_PIXELS>;

// Pixels touched, and the summed and the largest α T; the fourth is not used.
alias Sums = vec4f;

fn visit(held: Held, pixel: u32, centre: vec2f, sums: ptr<function, Sums>) {
    let transmittance = transmittances[pixel];
    let weight = transmittance * alpha_at(exponent_at(held.splat, centre - held.splat.mean), transmittance);
    if (weight == 0.0) {
        return;
    }
    transmittances[pixel] = transmittance - weight;
    if (is_median(transmittance, transmittance - weight)) {
        medians[pixel] = held.splat.depth;
    }
    *sums = vec4f((*sums).x + 1.0, (*sums).y + weight, max((*sums).z, weight), 0.0);
}

fn leave(held: Held, sums: Sums) {
    contribution_rows[held.slot] = sums;
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
    let pixel = tile_origin(view, tile) + vec2u(thread % TILE, thread / TILE);
    let inside = pixel.x < view.width && pixel.y < view.height;
    transmittances[thread] = select(0.0, 1.0, inside);
    medians[thread] = 0.0;
    workgroupBarrier();
    replay_tile(tile, drawn_ranges[tile], thread);
    workgroupBarrier();
    if (inside) {
        median_depths[pixel.y * view.width + pixel.x] = medians[thread];
    }
}
