// The boxes above the leaves, level by level from below. One workgroup.
import tree

@group(0) @binding(0) var<uniform> cloud: Cloud;
@group(0) @binding(1) var<storage, read_write> boxes: array<Box>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    for (var first = cloud.leaves / 2u; first > 0u; first = first / 2u) {
        for (var number = first + thread; number < 2u * first; number += THREADS) {
            let left = boxes[2u * number];
            let right = boxes[2u * number + 1u];
            boxes[number] = Box(min(left.low, right.low), max(left.high, right.high));
        }
        storageBarrier();
    }
}
