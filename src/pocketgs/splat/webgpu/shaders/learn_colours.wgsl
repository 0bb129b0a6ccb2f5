// One step of Adam on the colour transform of the step's photograph; then the mean of all photographs' transforms goes
// back to the identity. Nothing happens while the run is halted. One workgroup.
import view, update, update.status, patches, workgroups.sum

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> update: Update;
@group(0) @binding(2) var<storage, read> status: array<u32>;
@group(0) @binding(3) var<storage, read> colour_parts: array<f32>;
@group(0) @binding(4) var<storage, read_write> colours: array<f32>;

// How many numbers a transform has.
const NUMBERS: u32 = 12u;

// The gradient of each number: a thread takes one of them on.
fn gradient_of(thread: u32) -> f32 {
    var own = 0.0;
    for (var number = 0u; number < NUMBERS; number++) {
        var sum = 0.0;
        for (var part = thread; part < patches(view); part += THREADS) {
            sum += colour_parts[NUMBERS * part + number];
        }
        let total = workgroup_sum(sum, thread);
        if (thread == number) {
            own = total;
        }
    }
    return own;
}

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    let gradient = gradient_of(thread);
    let row = COLOUR_COLUMNS * update.photograph_row;
    let updates = colours[row + COLOUR_UPDATES] + 1.0;
    storageBarrier();
    if (status[HALTED] != 0u) {
        return;
    }
    if (thread == 0u) {
        colours[row + COLOUR_UPDATES] = updates;
    }
    if (thread >= NUMBERS) {
        return;
    }
    let place = row + thread;
    let slope = gradient + 2.0 * update.colour_weight * colours[place];
    let first = update.decay1 * colours[place + NUMBERS] + (1.0 - update.decay1) * slope;
    let second = update.decay2 * colours[place + 2u * NUMBERS] + (1.0 - update.decay2) * slope * slope;
    colours[place + NUMBERS] = first;
    colours[place + 2u * NUMBERS] = second;
    let mean = first / (1.0 - pow(update.decay1, updates));
    let spread = sqrt(second / (1.0 - pow(update.decay2, updates)));
    colours[place] -= update.colour_rate * mean / (spread + update.epsilon);
    var sum = 0.0;
    for (var photograph = 0u; photograph < update.photographs; photograph++) {
        sum += colours[COLOUR_COLUMNS * photograph + thread];
    }
    let centre = sum / f32(update.photographs);
    for (var photograph = 0u; photograph < update.photographs; photograph++) {
        colours[COLOUR_COLUMNS * photograph + thread] -= centre;
    }
}
