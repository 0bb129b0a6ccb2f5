// Give every cluster that the view may see something of its place among them, in the order of memory; and count the
// Gaussians in them. One workgroup.
import view, clusters, frustum.kind, scan.exclusive, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(2) var<storage, read> cluster_bounds: array<f32>;
@group(0) @binding(3) var<storage, read_write> cluster_places: array<u32>;
@group(0) @binding(4) var<storage, read_write> gaussian_count: array<u32>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    let clusters = (view.gaussians + THREADS - 1u) / THREADS;
    var clusters_before = 0u;
    var gaussians_before = 0u;
    for (var start = 0u; start < clusters; start += THREADS) {
        let cluster = start + thread;
        var found = vec4u();
        if (cluster < clusters && is_in_view(cluster)) {
            found = vec4u(1u, min(THREADS, view.gaussians - cluster * THREADS), 0u, 0u);
        }
        let before = exclusive_scan(found, thread);
        if (cluster < clusters) {
            cluster_places[cluster] = select(OUTSIDE, clusters_before + before.x, found.x == 1u);
        }
        clusters_before += scan_total().x;
        gaussians_before += scan_total().y;
    }
    if (thread == 0u) {
        gaussian_count[0] = gaussians_before;
    }
}
