// List every tile that each Gaussian reaches, in order of depth: the tile is the key to sort by, the place the value.
// One thread per Gaussian.
import view, ranks.slots, splats.read, tiles, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> splats: array<u32>;
@group(0) @binding(3) var<storage, read> first_slots: array<u32>;
@group(0) @binding(4) var<storage, read> intersection_count: array<u32>;
@group(0) @binding(5) var<storage, read_write> tile_keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> slots: array<u32>;
@group(0) @binding(7) var<storage, read_write> slot_splats: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = folded(workgroup) * THREADS + thread;
    let reached = slots_at(rank);
    if (reached.x == reached.y) {
        return;
    }
    var slot = reached.x;
    let end = reached.y;
    let i = order[rank];
    let ellipse = ellipse_of(read_splat(i));
    let rows = tile_rows(view, ellipse);
    for (var row = rows.x; row < rows.y; row++) {
        let columns = tile_columns(view, ellipse, row);
        for (var column = columns.x; column < columns.y && slot < end; column++) {
            tile_keys[slot] = row * view.tiles_across + column;
            slots[slot] = slot;
            slot_splats[slot] = i;
            slot++;
        }
    }
    // More may have been counted, see `counted_ellipse_of`: what is left goes to a tile that is not drawn.
    for (; slot < end; slot++) {
        tile_keys[slot] = view.tiles_across * view.tiles_down;
        slots[slot] = slot;
        slot_splats[slot] = i;
    }
}
