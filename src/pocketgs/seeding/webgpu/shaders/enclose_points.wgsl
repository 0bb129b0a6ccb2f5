// The boxes of the leaves. One thread per leaf.
import tree.points, workgroups

@group(0) @binding(0) var<uniform> cloud: Cloud;
@group(0) @binding(1) var<storage, read> positions: array<f32>;
@group(0) @binding(2) var<storage, read_write> boxes: array<Box>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let leaf = folded(workgroup) * THREADS + thread;
    if (leaf >= cloud.leaves) {
        return;
    }
    // An empty one is far from everything.
    var box = Box(vec3f(FAR), vec3f(-FAR));
    for (var point = leaf * LEAF; point < min((leaf + 1u) * LEAF, cloud.points); point++) {
        box = Box(min(box.low, position(point)), max(box.high, position(point)));
    }
    boxes[cloud.leaves + leaf] = box;
}
