// Candidates for points, which voxels bring together.
struct Merging {
    candidates: u32,
}

@group(0) @binding(0) var<uniform> merging: Merging;
