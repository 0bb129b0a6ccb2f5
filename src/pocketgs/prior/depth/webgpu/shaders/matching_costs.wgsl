// Compare the view with its source views, warped by every hypothesis: Hamming distances of census transforms, the mean
// of the two source views that agree best. One workgroup per patch of 16 x 16 pixels and 32 hypotheses.
//
// Four hypotheses stand in a word, and are sampled, compared and counted at once.
import sweep, sweep.band, photographs, bytes, workgroups

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<storage, read> photographs: array<u32>;
@group(0) @binding(2) var<storage, read> squares: array<u32>;
@group(0) @binding(3) var<storage, read> sources: array<vec4f>;
@group(0) @binding(4) var<storage, read> inverse_depths: array<f32>;
@group(0) @binding(5) var<storage, read_write> costs: array<u32>;

const WINDOW: u32 = 2u * RADIUS + 1u;
const SIDE: u32 = PATCH + 2u * RADIUS;
const PLACES: u32 = SIDE * SIDE;
// A window has 49 pixels, its centre among them, which never differs from itself: 28 stand in the first word.
const ROWS_IN_FIRST: u32 = 4u;

// The patch with its margin: grey levels of the view; then of a source view, at four hypotheses, and 255 where it does
// not see them.
var<workgroup> samples: array<u32, PLACES>;
var<workgroup> unseen: array<u32, PLACES>;

// Which pixels of the window at a place are darker than its centre.
fn census(place: u32) -> vec2u {
    let centre = samples[place + RADIUS * SIDE + RADIUS];
    var bits = vec2u();
    for (var row = 0u; row < WINDOW; row++) {
        for (var column = 0u; column < WINDOW; column++) {
            let bit = u32(samples[place + row * SIDE + column] < centre) << (row % ROWS_IN_FIRST * WINDOW + column);
            if (row < ROWS_IN_FIRST) {
                bits.x |= bit;
            } else {
                bits.y |= bit;
            }
        }
    }
    return bits;
}

// How many bits of the census there differ from the view's own, at four hypotheses.
fn differing(place: u32, own: vec2u) -> u32 {
    let centre = samples[place + RADIUS * SIDE + RADIUS];
    var count = 0u;
    for (var row = 0u; row < WINDOW; row++) {
        var bits = select(own.y, own.x, row < ROWS_IN_FIRST) >> (row % ROWS_IN_FIRST * WINDOW);
        for (var column = 0u; column < WINDOW; column++) {
            let darker = less(samples[place + row * SIDE + column], centre);
            count += (darker ^ ((bits & 1u) * HIGHEST)) >> 7u;
            bits >>= 1u;
        }
    }
    return count;
}

// Sample a source view bilinearly where a pixel of the view falls in it, at four hypotheses.
fn warp(source: u32, pixel: vec2f, depths: vec4f, place: u32) {
    let rows = array<vec4f, 3>(sources[4u * source], sources[4u * source + 1u], sources[4u * source + 2u]);
    let size = sources[4u * source + 3u].xy;
    let shift = vec3f(rows[0].w, rows[1].w, rows[2].w);
    let along = vec3f(rows[0].x, rows[1].x, rows[2].x) * pixel.x;
    let start = vec3f(rows[0].y, rows[1].y, rows[2].y) * pixel.y + vec3f(rows[0].z, rows[1].z, rows[2].z);
    let pixels = sweep.image_width * sweep.image_height;
    var greys = 0u;
    var hidden = 0u;
    for (var number = 0u; number < 4u; number++) {
        let fallen = along + (start + shift * depths[number]);
        // 0 / 0 is to be 0, so that all reads stay in bounds.
        let found = fallen.xy / select(fallen.z, 1e-30, fallen.z == 0.0);
        var sees = fallen.z > 0.0 && all(found >= vec2f()) && all(found < size);
        let corner = min(max(found - 0.5, vec2f()), size - 1.0);
        let whole = vec2u(corner);
        let share = corner - vec2f(whole);
        let offset = whole.y * sweep.image_width + whole.x;
        let square = squares[source * pixels + offset];
        let left = vec2f(vec2u(square, square >> 16u) & vec2u(255u));
        let right = vec2f(vec2u(square >> 8u, square >> 24u) & vec2u(255u));
        let between = left + (right - left) * share.x;
        greys |= u32(between.x + (between.y - between.x) * share.y + 0.5) << (8u * number);
        if (sweep.has_masks != 0u && sees) {
            sees = (photographs[(source + 1u) * pixels + offset] & MATCHED) != 0u;
        }
        hidden |= select(255u << (8u * number), 0u, sees);
    }
    samples[place] = greys;
    unseen[place] = hidden;
}

// Half of all bits where no source view sees a hypothesis; the only one's count; or the mean of the least two.
fn mean_of(least: u32, next: u32) -> u32 {
    var means = 0u;
    for (var shift = 0u; shift < 32u; shift += 8u) {
        let first = (least >> shift) & 255u;
        let second = (next >> shift) & 255u;
        means |= select(select((first + second) / 2u, first, second == 255u), BITS / 2u, first == 255u) << shift;
    }
    return means;
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let group = folded(workgroup);
    let across = (sweep.width + PATCH - 1u) / PATCH;
    let patches = across * ((sweep.band_rows + PATCH - 1u) / PATCH);
    let corner = vec2u(group % patches % across * PATCH, band_top() + group % patches / across * PATCH);
    let first = group / patches * CHUNK;
    let end = min(first + CHUNK, sweep.hypotheses);
    if (first >= end || corner.y >= band_bottom()) {
        return;
    }
    for (var place = thread; place < PLACES; place += THREADS) {
        let pixel = max(corner + vec2u(place % SIDE, place / SIDE), vec2u(RADIUS)) - RADIUS;
        let inside = min(pixel, vec2u(sweep.width, sweep.height) - 1u);
        samples[place] = grey_of(photographs[inside.y * sweep.image_width + inside.x]);
    }
    workgroupBarrier();
    let window = thread / PATCH * SIDE + thread % PATCH;
    let own = census(window);
    let pixel = corner + vec2u(thread % PATCH, thread / PATCH);
    let inside = pixel.x < sweep.width && pixel.y < band_bottom();
    var masked = false;
    if (inside) {
        masked = (photographs[pixel.y * sweep.image_width + pixel.x] & MATCHED) == 0u;
    }
    let row = (pixel.y - band_top()) * sweep.width + pixel.x;
    for (var word = first / 4u; 4u * word < end; word++) {
        let numbers = min(4u * word + vec4u(0u, 1u, 2u, 3u), vec4u(sweep.hypotheses - 1u));
        let depths = vec4f(
            inverse_depths[numbers.x],
            inverse_depths[numbers.y],
            inverse_depths[numbers.z],
            inverse_depths[numbers.w],
        );
        var least = 0xffffffffu;
        var next = 0xffffffffu;
        for (var source = 0u; source < sweep.sources; source++) {
            workgroupBarrier();
            for (var place = thread; place < PLACES; place += THREADS) {
                let there = vec2f(corner) + vec2f(vec2u(place % SIDE, place / SIDE)) - f32(RADIUS) + 0.5;
                warp(source, there, depths, place);
            }
            workgroupBarrier();
            let count = differing(window, own) | unseen[window + RADIUS * SIDE + RADIUS];
            let fewer = filled(less(count, least));
            let more = picked(fewer, least, count);
            least = picked(fewer, count, least);
            next = picked(filled(less(more, next)), more, next);
        }
        if (inside) {
            costs[row * 2u * sweep.lanes + word] = select(mean_of(least, next), BITS / 2u * ONES, masked);
        }
    }
}
