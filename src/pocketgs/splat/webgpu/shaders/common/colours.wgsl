// The photographs' colour transforms: `splat/colours.py` says what a row of the table `colours` holds.

section apply
// What the photograph's camera makes of a rendered colour. The pass binds `colours`.
fn in_photograph(colour: vec3f) -> vec3f {
    var result = colour;
    if (update.colours_learned == 1u) {
        for (var channel = 0u; channel < 3u; channel++) {
            let place = COLOUR_COLUMNS * update.photograph_row + 4u * channel;
            let change = vec3f(colours[place], colours[place + 1u], colours[place + 2u]);
            result[channel] += dot(change, colour) + colours[place + 3u];
        }
    }
    return result;
}

section adjoint
// From the gradient of what `in_photograph` gives to that of the rendered colour.
fn to_rendering(gradient: vec3f) -> vec3f {
    var result = gradient;
    if (update.colours_learned == 1u) {
        for (var channel = 0u; channel < 3u; channel++) {
            let place = COLOUR_COLUMNS * update.photograph_row + 4u * channel;
            result += gradient[channel] * vec3f(colours[place], colours[place + 1u], colours[place + 2u]);
        }
    }
    return result;
}
