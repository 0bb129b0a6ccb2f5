// The gradients of each Gaussian's centre on the image, signed and absolute, and of its channels: the sums of its rows.
// `channel_gradients` is all 0 before. One thread per Gaussian, in order of depth.
import view, ranks.slots, splats.read, channel_rows.gather, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> first_slots: array<u32>;
@group(0) @binding(4) var<storage, read> intersection_count: array<u32>;
@group(0) @binding(5) var<storage, read> gradient_rows: array<f32>;
@group(0) @binding(6) var<storage, read_write> channel_gradients: array<f32>;

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
    let i = order[rank];
    let centre = inverse_covariance(read_splat(i)) * gather(i, reached.x, reached.y).offset;
    let row = i * (CENTRE_WORDS + 3u * view.channel_groups);
    channel_gradients[row] = centre.x;
    channel_gradients[row + 1u] = centre.y;
    for (var word = 0u; word < 2u + 3u * view.channel_groups; word++) {
        channel_gradients[row + 2u + word] = gather_word(reached.x, reached.y, ABSOLUTE_WORD + word);
    }
}
