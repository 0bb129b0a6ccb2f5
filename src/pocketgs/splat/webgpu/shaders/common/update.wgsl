// One update of the scene: the loss's weights, Adam's constants, and the rates of this iteration.
struct Update {
    // Weights of a pixel channel's |x - y| and (x - y)², divided by the number of channels of the image.
    absolute_weight: f32,
    squared_weight: f32,
    // Weight of 1 - SSIM, divided by the number of whole windows and channels; 0 for an image too small for a window.
    structural_weight: f32,
    // The structural term's constant: its weight, undivided.
    structural_share: f32,
    // Weights of a Gaussian's ‖log s‖², of its opacity, and of its standard deviations, divided by the number of
    // Gaussians.
    scale_weight: f32,
    opacity_weight: f32,
    size_weight: f32,
    mean_rate: f32,
    log_scale_rate: f32,
    rotation_rate: f32,
    opacity_rate: f32,
    sh_dc_rate: f32,
    sh_rest_rate: f32,
    decay1: f32,
    decay2: f32,
    // 1 / (1 - β^t) of either moment.
    unbias1: f32,
    unbias2: f32,
    epsilon: f32,
    // Where in `losses` this step's loss goes.
    loss_slot: u32,
    // 1 if Gaussians without a gradient keep their parameters and moments.
    seen_only: u32,
    // Coefficients of spherical harmonics per channel that are trained.
    trained_coefficients: u32,
    // Of the noise on positions; 0 for none.
    noise_size: f32,
    noise_seed: u32,
    // 1 if the colour transform of the step's photograph is applied and learned; which row of `colours` it is, and how
    // many photographs there are.
    colours_learned: u32,
    photograph_row: u32,
    photographs: u32,
    // Of the transform: its rate, and the weight of its squared difference from the identity.
    colour_rate: f32,
    colour_weight: f32,
}

section status
// Words of `status`, which outlives the image: how many steps have been completed; whether a step needed more room for
// intersections than there is, after which nothing happens until the host has made room; and how many it needed.
const STEPS: u32 = 0u;
const HALTED: u32 = 1u;
const NEEDED: u32 = 2u;

section regularised
// Whether the loss has terms of the Gaussians themselves, so that all of them have gradients.
fn is_regularised() -> bool {
    return update.scale_weight != 0.0 || update.opacity_weight != 0.0 || update.size_weight != 0.0;
}
