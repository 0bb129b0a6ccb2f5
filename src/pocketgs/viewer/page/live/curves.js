/**
 * The curves of a run: loss, and PSNR on held-out views.
 *
 * @module
 */

/** @typedef {{iteration: number, loss: number | null, held_out_psnr: number | null}} Sample */

const MARGIN = 6;

/**
 * Draw both curves, each over its own range.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {Sample[]} samples
 * @param {number} iterations of the whole run
 */
export function drawCurves(canvas, samples, iterations) {
    const scale = window.devicePixelRatio;
    [canvas.width, canvas.height] = [canvas.clientWidth * scale, canvas.clientHeight * scale];
    const context = canvas.getContext("2d");
    context.scale(scale, scale);
    const style = getComputedStyle(canvas);
    const box = { width: canvas.clientWidth, height: canvas.clientHeight };
    drawGrid(context, box, style.getPropertyValue("--line"));
    const last = Math.max(iterations, samples.at(-1)?.iteration ?? 0, 1);
    // Losses fall by orders of magnitude: the logarithm shows late changes too.
    drawCurve(context, box, last, pointsOf(samples, "loss", Math.log), style.getPropertyValue("--warm"));
    const measured = pointsOf(samples, "held_out_psnr", Number).filter(isNew);
    drawCurve(context, box, last, measured, style.getPropertyValue("--accent"));
}

function pointsOf(samples, name, transform) {
    const points = samples.map((sample) => ({ at: sample.iteration, value: sample[name] }));
    const known = points.filter(({ value }) => value !== null && value !== undefined);
    return known.map(({ at, value }) => ({ at, value: transform(value) })).filter(({ value }) => Number.isFinite(value));
}

/** Whether a PSNR is new: the last one is repeated until the next evaluation. */
function isNew({ value }, i, points) {
    return i === 0 || value !== points[i - 1].value;
}

function drawGrid(context, { width, height }, colour) {
    context.strokeStyle = colour;
    context.lineWidth = 1;
    for (const share of [0, 0.5, 1]) {
        const y = Math.round(MARGIN + share * (height - 2 * MARGIN)) + 0.5;
        context.beginPath();
        context.moveTo(0, y);
        context.lineTo(width, y);
        context.stroke();
    }
}

function drawCurve(context, { width, height }, last, points, colour) {
    const values = points.map(({ value }) => value);
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const x = ({ at }) => MARGIN + (at / last) * (width - 2 * MARGIN);
    const y = ({ value }) => MARGIN + ((high - value) / (high - low || 1)) * (height - 2 * MARGIN);
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 2;
    context.lineJoin = "round";
    context.beginPath();
    points.forEach((point) => context.lineTo(x(point), y(point)));
    context.stroke();
    if (points.length) {
        context.beginPath();
        context.arc(x(points.at(-1)), y(points.at(-1)), 3, 0, 2 * Math.PI);
        context.fill();
    }
}
