// Let the first group of channels be the splats' colours. One thread per Gaussian, in order of depth.
import view, ranks.slots, splats.read, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> first_slots: array<u32>;
@group(0) @binding(4) var<storage, read> intersection_count: array<u32>;
@group(0) @binding(5) var<storage, read_write> channels: array<f32>;

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
    let colour = read_splat(order[rank]).colour;
    let first = 3u * order[rank] * view.channel_groups;
    channels[first] = colour.r;
    channels[first + 1u] = colour.g;
    channels[first + 2u] = colour.b;
}
