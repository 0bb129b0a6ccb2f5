// Find extrema of the difference of Gaussians in an octave, to a fraction of a pixel (Lowe, "Distinctive image features
// from scale-invariant keypoints", 2004, sections 3.1 and 4). One thread per pixel of a layer.
import scale_space, feature, workgroups

@group(0) @binding(0) var<uniform> image: Image;
@group(0) @binding(1) var<storage, read> scale_space: array<f32>;
@group(0) @binding(2) var<storage, read_write> counts: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> keypoints: array<Feature>;

// Per grey level, of 255.
const UNIT: f32 = 1.0 / 255.0;

fn difference(layer: i32, place: i32) -> f32 {
    let at = u32(layer) * octave_pixels() + u32(place);
    return scale_space[at + octave_pixels()] - scale_space[at];
}

// Whether no neighbour in place and scale is farther from 0 on the same side.
fn is_extremum(layer: i32, place: i32, width: i32) -> bool {
    let value = difference(layer, place);
    if (value == 0.0) {
        return false;
    }
    let side = sign(value);
    for (var scale = layer - 1; scale <= layer + 1; scale++) {
        for (var row = -1; row <= 1; row++) {
            for (var column = -1; column <= 1; column++) {
                if (side * difference(scale, place + row * width + column) > side * value) {
                    return false;
                }
            }
        }
    }
    return true;
}

// Values, slopes and curvatures around a pixel by column, row and layer.
struct Surface {
    value: f32,
    slope: vec3f,
    curvature: mat3x3f,
}

fn surface_at(layer: i32, place: i32, width: i32) -> Surface {
    let value = difference(layer, place);
    let ahead = vec3f(difference(layer, place + 1), difference(layer, place + width), difference(layer + 1, place));
    let behind = vec3f(difference(layer, place - 1), difference(layer, place - width), difference(layer - 1, place));
    let across_down = difference(layer, place + width + 1) - difference(layer, place + width - 1)
        - difference(layer, place - width + 1) + difference(layer, place - width - 1);
    let across_scale = difference(layer + 1, place + 1) - difference(layer + 1, place - 1)
        - difference(layer - 1, place + 1) + difference(layer - 1, place - 1);
    let down_scale = difference(layer + 1, place + width) - difference(layer + 1, place - width)
        - difference(layer - 1, place + width) + difference(layer - 1, place - width);
    let own = (ahead + behind - 2.0 * value) * UNIT;
    let mixed = vec3f(across_down, across_scale, down_scale) * (0.25 * UNIT);
    return Surface(
        value * UNIT,
        (ahead - behind) * (0.5 * UNIT),
        mat3x3f(own.x, mixed.x, mixed.y, mixed.x, own.y, mixed.z, mixed.y, mixed.z, own.z),
    );
}

// Where the quadratic through the neighbours has its extremum, relative to the pixel, by Cramer's rule.
fn offset_of(surface: Surface) -> vec3f {
    let a = surface.curvature;
    let right = -surface.slope;
    let determinant = dot(a[0], cross(a[1], a[2]));
    if (determinant == 0.0) {
        return vec3f(1e9);
    }
    return vec3f(
        dot(right, cross(a[1], a[2])),
        dot(a[0], cross(right, a[2])),
        dot(a[0], cross(a[1], right)),
    ) / determinant;
}

// Edges have no place along themselves: the two curvatures in the image must not be too different.
fn is_on_edge(curvature: mat3x3f) -> bool {
    let trace = curvature[0].x + curvature[1].y;
    let determinant = curvature[0].x * curvature[1].y - curvature[0].y * curvature[0].y;
    return determinant <= 0.0 || trace * trace * EDGE >= (EDGE + 1.0) * (EDGE + 1.0) * determinant;
}

fn add(column: f32, row: f32, layer: i32, offset: vec3f, response: f32) {
    let number = atomicAdd(&counts[KEYPOINTS], 1u);
    if (number < image.keypoint_room) {
        let scale = SIGMA * exp2((f32(layer) + offset.z) / f32(LAYERS));
        keypoints[number] =
            Feature(column + offset.x, row + offset.y, scale, response, 0.0, image.octave, u32(layer), 0u);
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = folded(workgroup) * THREADS + thread;
    let width = i32(octave_width());
    let height = i32(octave_height());
    var layer = 1 + i32(index / octave_pixels());
    var column = i32(index % octave_pixels()) % width;
    var row = i32(index % octave_pixels()) / width;
    let border = i32(BORDER);
    let inside = column >= border && column < width - border && row >= border && row < height - border;
    if (layer > i32(LAYERS) || !inside || !is_extremum(layer, row * width + column, width)) {
        return;
    }
    for (var attempt = 0u; attempt < MOST_MOVES; attempt++) {
        let surface = surface_at(layer, row * width + column, width);
        let offset = offset_of(surface);
        if (all(abs(offset) < vec3f(0.5))) {
            let response = abs(surface.value + 0.5 * dot(surface.slope, offset));
            if (response * f32(LAYERS) >= CONTRAST && !is_on_edge(surface.curvature)) {
                add(f32(column), f32(row), layer, offset, response);
            }
            return;
        }
        if (any(abs(offset) > vec3f(1e6))) {
            return;
        }
        column += i32(round(offset.x));
        row += i32(round(offset.y));
        layer += i32(round(offset.z));
        if (layer < 1 || layer > i32(LAYERS) || column < border || column >= width - border
            || row < border || row >= height - border) {
            return;
        }
    }
}
