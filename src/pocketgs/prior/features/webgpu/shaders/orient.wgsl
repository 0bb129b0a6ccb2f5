// Give each keypoint of an octave the directions of the strongest gradients around it; each makes a feature (Lowe 2004,
// section 5). One thread per keypoint.
import scale_space, scale_space.gradient, feature, workgroups

@group(0) @binding(0) var<uniform> image: Image;
@group(0) @binding(1) var<storage, read> scale_space: array<f32>;
@group(0) @binding(2) var<storage, read_write> counts: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read> keypoints: array<Feature>;
@group(0) @binding(4) var<storage, read_write> features: array<Feature>;

// Gradients around a keypoint by direction, those near it counting most.
fn directions(keypoint: Feature) -> array<f32, DIRECTIONS> {
    var sums: array<f32, DIRECTIONS>;
    let width = i32(octave_width());
    let height = i32(octave_height());
    let middle = vec2i(round(vec2f(keypoint.x, keypoint.y)));
    let sigma = ORIENTATION_SIGMA * keypoint.scale;
    let radius = i32(round(3.0 * sigma));
    for (var down = -radius; down <= radius; down++) {
        let row = middle.y + down;
        if (row <= 0 || row >= height - 1) {
            continue;
        }
        for (var across = -radius; across <= radius; across++) {
            let column = middle.x + across;
            if (column <= 0 || column >= width - 1) {
                continue;
            }
            let found = gradient(u32(keypoint.layer) * octave_pixels() + u32(row * width + column));
            let bin = u32(round(found.x * (f32(DIRECTIONS) / TURN))) % DIRECTIONS;
            sums[bin] += found.y * exp(-0.5 * f32(down * down + across * across) / (sigma * sigma));
        }
    }
    return sums;
}

fn add(keypoint: Feature, angle: f32) {
    let number = atomicAdd(&counts[FEATURES], 1u);
    if (number < image.feature_room) {
        var feature = keypoint;
        feature.angle = angle;
        features[number] = feature;
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = folded(workgroup) * THREADS + thread;
    if (number >= min(atomicLoad(&counts[KEYPOINTS]), image.keypoint_room) || keypoints[number].octave != image.octave) {
        return;
    }
    var sums = directions(keypoints[number]);
    var smoothed: array<f32, DIRECTIONS>;
    var largest = 0.0;
    for (var bin = 0u; bin < DIRECTIONS; bin++) {
        let far = sums[(bin + DIRECTIONS - 2u) % DIRECTIONS] + sums[(bin + 2u) % DIRECTIONS];
        let near = sums[(bin + DIRECTIONS - 1u) % DIRECTIONS] + sums[(bin + 1u) % DIRECTIONS];
        smoothed[bin] = (far + 4.0 * near + 6.0 * sums[bin]) / 16.0;
        largest = max(largest, smoothed[bin]);
    }
    for (var bin = 0u; bin < DIRECTIONS; bin++) {
        let before = smoothed[(bin + DIRECTIONS - 1u) % DIRECTIONS];
        let after = smoothed[(bin + 1u) % DIRECTIONS];
        let own = smoothed[bin];
        if (own > before && own > after && own >= PEAK * largest) {
            // The top of the parabola through the three.
            let top = f32(bin) + 0.5 * (before - after) / (before - 2.0 * own + after);
            let turned = select(top, top + f32(DIRECTIONS), top < 0.0);
            add(keypoints[number], turned * (TURN / f32(DIRECTIONS)));
        }
    }
}
