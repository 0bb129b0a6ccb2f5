// Add up the parts of the loss, and count the step as completed unless the run is halted. One workgroup.
import view, update, update.status, update.regularised, patches, workgroups.sum

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> update: Update;
@group(0) @binding(2) var<storage, read> loss_parts: array<vec2f>;
@group(0) @binding(3) var<storage, read> regulariser_parts: array<f32>;
@group(0) @binding(4) var<storage, read_write> losses: array<f32>;
@group(0) @binding(5) var<storage, read_write> status: array<u32>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    var sum = 0.0;
    for (var part = thread; part < patches(view); part += THREADS) {
        let parts = loss_parts[part];
        sum += parts.x - select(0.0, update.structural_weight * parts.y, update.structural_weight > 0.0);
    }
    if (is_regularised()) {
        for (var part = thread; part * THREADS < view.gaussians; part += THREADS) {
            sum += regulariser_parts[part];
        }
    }
    let total = workgroup_sum(sum, thread);
    if (thread == 0u && status[HALTED] == 0u) {
        losses[update.loss_slot] = update.structural_share + total;
        status[STEPS] += 1u;
    }
}
