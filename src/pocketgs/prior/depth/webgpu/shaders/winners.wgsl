// The cheapest hypothesis of every pixel: its depth, with sub-step precision by a parabola through it and its
// neighbours, and the margin by which it is cheaper than its best rival. One thread per pixel of a band.
//
// A winner at the near end of the range is none: the true depth may be outside. So is one at the far end, unless the
// range reaches to infinity.
import sweep, sweep.band, photographs, workgroups

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<storage, read> photographs: array<u32>;
@group(0) @binding(2) var<storage, read> inverse_depths: array<f32>;
@group(0) @binding(3) var<storage, read> totals: array<u32>;
@group(0) @binding(4) var<storage, read_write> winner_depths: array<f32>;
@group(0) @binding(5) var<storage, read_write> margins: array<f32>;

const NO_RIVAL: u32 = 65535u;

fn total(first: u32, hypothesis: u32) -> u32 {
    return (totals[first + hypothesis / 2u] >> (16u * (hypothesis % 2u))) & 65535u;
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let place = folded(workgroup) * THREADS + thread;
    let row = band_top() + place / sweep.width;
    if (row >= band_bottom()) {
        return;
    }
    let column = place % sweep.width;
    let pixel = row * sweep.width + column;
    let first = place * 4u * sweep.lanes;
    var best = 0u;
    var least = NO_RIVAL;
    for (var hypothesis = 0u; hypothesis < sweep.hypotheses; hypothesis++) {
        let cost = total(first, hypothesis);
        if (cost < least) {
            best = hypothesis;
            least = cost;
        }
    }
    var rival = NO_RIVAL;
    for (var hypothesis = 0u; hypothesis < sweep.hypotheses; hypothesis++) {
        let distance = max(hypothesis, best) - min(hypothesis, best);
        rival = select(rival, min(rival, total(first, hypothesis)), distance > RIVAL_DISTANCE);
    }
    var depth = 0.0;
    var margin = 0.0;
    // If all hypotheses cost the same, there is no winner.
    if (best + 1u < sweep.hypotheses && !(best == 0u && rival == least)) {
        let centre = f32(least);
        let high = f32(total(first, best + 1u));
        var low = high;
        if (best > 0u) {
            low = f32(total(first, best - 1u));
        }
        let curvature = low - 2.0 * centre + high;
        var fraction = 0.0;
        if (curvature > 0.0) {
            fraction = 0.5 * (low - high) / curvature;
        }
        margin = f32(rival - least) / f32(max(rival, NOISE * sweep.paths));
        let usable = (photographs[row * sweep.image_width + column] & USABLE) != 0u;
        if (usable && !(sweep.is_bounded != 0u && best == 0u)) {
            depth = 1.0 / (inverse_depths[best] + fraction * sweep.step);
        }
    }
    winner_depths[pixel] = depth;
    margins[pixel] = margin;
}
