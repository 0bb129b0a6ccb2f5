// The mean of a voxel's candidates, weighted by their confidence. One thread per candidate, in the order of the sort: that
// of a voxel's first candidate adds them up.
import merging, workgroups

@group(0) @binding(1) var<storage, read> positions: array<f32>;
// Colour, direction and confidence.
@group(0) @binding(2) var<storage, read> attributes: array<f32>;
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read> heads: array<u32>;
// Voxels that began before each candidate, in the order of the sort.
@group(0) @binding(5) var<storage, read> places: array<u32>;
@group(0) @binding(6) var<storage, read_write> merged: array<f32>;

fn position_of(i: u32) -> vec3f {
    return vec3f(positions[3u * i], positions[3u * i + 1u], positions[3u * i + 2u]);
}

fn attribute_of(i: u32, first: u32) -> vec3f {
    let word = ATTRIBUTES * i + first;
    return vec3f(attributes[word], attributes[word + 1u], attributes[word + 2u]);
}

fn write_vector(word: u32, value: vec3f) {
    for (var axis = 0u; axis < 3u; axis++) {
        merged[word + axis] = value[axis];
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = folded(workgroup) * THREADS + thread;
    if (rank >= merging.candidates || heads[order[min(rank, merging.candidates - 1u)]] == 0u) {
        return;
    }
    // Relative to the first, single precision loses nothing.
    let origin = position_of(order[rank]);
    var offset = vec3f();
    var colour = vec3f();
    var direction = vec3f();
    var weight = 0.0;
    var end = rank;
    loop {
        let i = order[end];
        let confidence = attributes[ATTRIBUTES * i + 6u];
        offset += confidence * (position_of(i) - origin);
        colour += confidence * attribute_of(i, 0u);
        direction += confidence * attribute_of(i, 3u);
        weight += confidence;
        end++;
        if (end == merging.candidates || heads[order[min(end, merging.candidates - 1u)]] == 1u) {
            break;
        }
    }
    let row = MERGED_WORDS * places[rank];
    write_vector(row, origin + offset / weight);
    write_vector(row + 3u, colour / weight);
    write_vector(row + 6u, direction / weight);
    merged[row + 9u] = weight;
    merged[row + 10u] = f32(end - rank);
}
