/**
 * Values of the uniform buffer of a step; the twin of `update_values` in `frame_values.py`.
 *
 * @module
 */

/**
 * Weight of 1 - SSIM; 0 for images too small for a window.
 *
 * @param {{photometric: string, dssim_weight: number}} loss
 * @param {{width: number, height: number}} size
 * @param {number} window pixels of SSIM's window on each side
 * @returns {number}
 */
export function structuralShare(loss, { width, height }, window) {
    return loss.photometric === "l1-dssim" && Math.min(width, height) >= window ? loss.dssim_weight : 0;
}

/**
 * Fields of the struct `Update`, for a recipe without noise and without learned colours.
 *
 * @param {Object} recipe its loss and Adam's constants
 * @param {import("./rates.js").Rates} rates of this iteration
 * @param {{width: number, height: number}} camera
 * @param {Object<string, number>} symbols with gaussians, coefficients and photographs
 * @param {number} step number of steps including this one
 * @param {number} view number of the photograph
 * @param {{ssim_window: number, kept_losses: number}} engine
 * @returns {Object<string, number>}
 */
export function updateValues({ loss, adam }, rates, camera, symbols, step, view, engine) {
    const { width, height } = camera;
    const gaussians = Math.max(symbols.gaussians, 1);
    const structural = structuralShare(loss, camera, engine.ssim_window);
    const border = engine.ssim_window - 1;
    const channels = 3 * width * height;
    const windows = 3 * Math.max((width - border) * (height - border), 1);
    const isSquared = loss.photometric === "l2";
    const unbiased = (beta) => (beta > 0 ? 1 / -Math.expm1(step * Math.log(beta)) : 1);
    return {
        absolute_weight: isSquared ? 0 : (1 - structural) / channels,
        squared_weight: isSquared ? 1 / channels : 0,
        structural_weight: structural / windows,
        structural_share: structural,
        scale_weight: loss.scale_weight / gaussians,
        opacity_weight: loss.opacity_weight / gaussians,
        size_weight: loss.size_weight / gaussians,
        mean_rate: rates.means,
        log_scale_rate: rates.log_scales,
        rotation_rate: rates.rotations,
        opacity_rate: rates.opacity_logits,
        sh_dc_rate: rates.sh_dc,
        sh_rest_rate: rates.sh_rest,
        decay1: adam.beta1,
        decay2: adam.beta2,
        unbias1: unbiased(adam.beta1),
        unbias2: unbiased(adam.beta2),
        epsilon: adam.epsilon,
        loss_slot: (step - 1) % engine.kept_losses,
        seen_only: Number(adam.seen_only),
        trained_coefficients: symbols.coefficients,
        noise_size: 0,
        noise_seed: 0,
        colours_learned: 0,
        photograph_row: view,
        photographs: symbols.photographs,
        colour_rate: 0,
        colour_weight: 0,
    };
}
