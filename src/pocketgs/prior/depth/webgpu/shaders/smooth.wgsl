// Remove the steps between hypotheses on slanted surfaces: a bilateral filter on inverse depth, over a disc, with the
// image mirrored at its border. Unknown depths take no part. One thread per pixel.
import sweep, mirrored, workgroups

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<storage, read> winner_depths: array<f32>;
@group(0) @binding(2) var<storage, read_write> depths: array<f32>;

const REACH: i32 = i32(SMOOTHING_WINDOW / 2u);

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = folded(workgroup) * THREADS + thread;
    if (pixel >= sweep.width * sweep.height) {
        return;
    }
    let depth = winner_depths[pixel];
    if (depth <= 0.0) {
        depths[pixel] = 0.0;
        return;
    }
    let centre = 1.0 / depth;
    let column = i32(pixel % sweep.width);
    let row = i32(pixel / sweep.width);
    var weights = 0.0;
    var sum = 0.0;
    for (var y = -REACH; y <= REACH; y++) {
        let line = mirrored(row + y, i32(sweep.height)) * sweep.width;
        for (var x = -REACH; x <= REACH; x++) {
            let other = winner_depths[line + mirrored(column + x, i32(sweep.width))];
            if (x * x + y * y > REACH * REACH || other <= 0.0) {
                continue;
            }
            let inverse = 1.0 / other;
            let away = f32(x * x + y * y) / (SMOOTHING_WIDTH * SMOOTHING_WIDTH);
            let different = (inverse - centre) / (SMOOTHING_STEPS * sweep.step);
            let weight = exp(-0.5 * (away + different * different));
            weights += weight;
            sum += weight * (inverse - centre);
        }
    }
    depths[pixel] = 1.0 / (centre + sum / weights);
}
