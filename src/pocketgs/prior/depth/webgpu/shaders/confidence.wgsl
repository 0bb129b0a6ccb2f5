// The confidence of every depth of a view, see `prior/depth/confidence.py`; 0 below the least. One thread per pixel.
import comparison, comparison.votes, workgroups

@group(0) @binding(0) var<uniform> comparison: Comparison;
@group(0) @binding(1) var<storage, read> votes: array<u32>;
// Share by which a depth is cheaper than the next best.
@group(0) @binding(2) var<storage, read> margins: array<f32>;
@group(0) @binding(3) var<storage, read_write> confidences: array<f32>;

// Beyond so many agreeing views, no doubt is left in single precision.
const SURE: i32 = 25;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = folded(workgroup) * THREADS + thread;
    if (pixel >= comparison.width * comparison.height) {
        return;
    }
    let agreeing = f32(agreeing_of(votes[pixel]));
    let contradicting = f32(contradicting_of(votes[pixel]));
    let certainty = 1.0 - ldexp(1.0, -min(i32(agreeing), SURE));
    let support = certainty * agreeing / max(agreeing + contradicting, 1.0);
    let confidence = support * min(margins[pixel] / CLEAR_MARGIN, 1.0);
    confidences[pixel] = select(0.0, confidence, confidence >= comparison.least);
}
