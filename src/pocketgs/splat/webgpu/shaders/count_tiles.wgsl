// How many tiles each of the given splats reaches: none where its opacity is below 1/255. The order before sorting is that
// of memory. One thread per splat.
import view, splats.read, tiles, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<u32>;
@group(0) @binding(2) var<storage, read_write> order: array<u32>;
@group(0) @binding(3) var<storage, read_write> tile_counts: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = folded(workgroup) * THREADS + thread;
    if (i >= view.gaussians) {
        return;
    }
    order[i] = i;
    tile_counts[i] = 0u;
    let splat = read_splat(i);
    if (splat.log2_opacity >= LOG2_ALPHA_MIN) {
        tile_counts[i] = count_tiles(view, splat);
    }
}
