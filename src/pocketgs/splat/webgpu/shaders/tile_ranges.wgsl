// Find where each tile's intersections begin among the sorted ones; `tile_starts` is all 0 before. One thread each.
import view, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> intersection_count: array<u32>;
@group(0) @binding(2) var<storage, read> tile_keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> tile_starts: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let intersection = folded(workgroup) * THREADS + thread;
    let intersections = intersection_count[0];
    if (intersection >= intersections) {
        return;
    }
    let tile = tile_keys[intersection];
    // Tiles without intersections begin where the next one does.
    var unset = 0u;
    if (intersection > 0u) {
        unset = tile_keys[intersection - 1u] + 1u;
    }
    for (; unset <= tile; unset++) {
        tile_starts[unset] = intersection;
    }
    if (intersection == intersections - 1u) {
        for (; unset <= view.tiles_across * view.tiles_down; unset++) {
            tile_starts[unset] = intersections;
        }
    }
}
