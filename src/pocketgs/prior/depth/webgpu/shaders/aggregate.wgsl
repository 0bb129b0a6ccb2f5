// Add up, along the paths of one direction, the least cost of reaching each pixel and hypothesis (Hirschmüller 2008,
// equation 13): L(d) = C(d) + min(L'(d), L'(d ± 1) + P1, min L' + P2) - min L'.
//
// A lane of threads is a group of LANE hypotheses; `lanes` of them follow a line, and a workgroup takes as many lines
// as it has threads for. Lines that are not rows go down or up by one row at each step. Oblique ones that leave the
// image at one side come back at the other, where another path begins: so there are as many lines as columns. Where a
// band ends, `carried` hands the paths over to the next.
import sweep, sweep.band, photographs, workgroups

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<storage, read> photographs: array<u32>;
@group(0) @binding(2) var<storage, read> costs: array<vec2u>;
@group(0) @binding(3) var<storage, read_write> totals: array<vec4u>;
@group(0) @binding(4) var<storage, read> carried_in: array<vec4i>;
@group(0) @binding(5) var<storage, read_write> carried_out: array<vec4i>;

// The paths' step in pixels, and whether they are the first to be added up.
override down: i32;
override across: i32;
override is_first: u32;

// L of a lane's hypotheses.
struct Reached {
    low: vec4i,
    high: vec4i,
}

// The least L of each lane, and those at its ends; of the latest pixel, and of the one before, in turn.
const TOLD: u32 = 2u * PATH_THREADS;
var<workgroup> least_of_lane: array<i32, TOLD>;
var<workgroup> first_of_lane: array<i32, TOLD>;
var<workgroup> last_of_lane: array<i32, TOLD>;

fn tell(reached: Reached, place: u32) {
    let lesser = min(reached.low, reached.high);
    least_of_lane[place] = min(min(lesser.x, lesser.y), min(lesser.z, lesser.w));
    first_of_lane[place] = reached.low.x;
    last_of_lane[place] = reached.high.w;
}

// One pixel further, given the penalty of a large step and where the lanes have told of the pixel before.
fn extended(before: Reached, own: Reached, jump: i32, place: u32, lane: u32) -> Reached {
    var least = i32(OUT_OF_REACH);
    for (var other = 0u; other < sweep.lanes; other++) {
        least = min(least, least_of_lane[place - lane + other]);
    }
    var below = i32(OUT_OF_REACH);
    var above = i32(OUT_OF_REACH);
    if (lane > 0u) {
        below = last_of_lane[place - 1u];
    }
    if (lane + 1u < sweep.lanes) {
        above = first_of_lane[place + 1u];
    }
    let small = i32(sweep.small_step);
    let far = vec4i(least + jump);
    let near_low = min(vec4i(below, before.low.xyz), vec4i(before.low.yzw, before.high.x)) + small;
    let near_high = min(vec4i(before.low.w, before.high.xyz), vec4i(before.high.yzw, above)) + small;
    return Reached(
        own.low + min(min(before.low, near_low), far) - least,
        own.high + min(min(before.high, near_high), far) - least,
    );
}

fn bytes_of(word: u32) -> vec4i {
    return vec4i((vec4u(word) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(255u));
}

// Two numbers of 16 bits in each of two words.
fn pairs_of(values: vec4i) -> vec2u {
    let numbers = vec4u(values);
    return numbers.xz | (numbers.yw << vec2u(16u));
}

fn grey_at(pixel: vec2i) -> i32 {
    return i32(grey_of(photographs[u32(pixel.y) * sweep.image_width + u32(pixel.x)]));
}

fn is_inside(pixel: vec2i) -> bool {
    return all(pixel >= vec2i()) && all(pixel < vec2i(i32(sweep.width), i32(sweep.height)));
}

// A column that has left the image by less than its width, back at the other side.
fn wrapped(column: i32) -> i32 {
    let width = i32(sweep.width);
    return select(select(column, column + width, column < 0), column - width, column >= width);
}

@compute @workgroup_size(PATH_THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let top = band_top();
    let rows = band_bottom() - top;
    let lines_at_once = PATH_THREADS / sweep.lanes;
    let line = folded(workgroup) * lines_at_once + thread / sweep.lanes;
    let lane = thread % sweep.lanes;
    let length = select(rows, sweep.width, down == 0);
    let busy = thread / sweep.lanes < lines_at_once && line < select(sweep.width, rows, down == 0);

    // Hypotheses beyond the last are never reached, and take no part in sums.
    let numbers = vec4u(0u, 1u, 2u, 3u) + LANE * lane;
    let low_counts = numbers < vec4u(sweep.hypotheses);
    let high_counts = numbers + 4u < vec4u(sweep.hypotheses);
    let beyond = vec4i(i32(OUT_OF_REACH));

    let way = vec2i(across, down);
    var here = vec2i(i32(line), select(i32(top + rows) - 1, i32(top), down > 0));
    if (down == 0) {
        here = vec2i(select(i32(sweep.width) - 1, 0, across > 0), i32(top + line));
    }
    var last = here;
    var reached = Reached(beyond, beyond);
    if (busy && down != 0 && is_inside(here - way)) {
        let place = 2u * (u32(here.x - way.x) * sweep.lanes + lane);
        reached = Reached(carried_in[place], carried_in[place + 1u]);
    }
    tell(reached, thread);
    workgroupBarrier();

    for (var taken = 0u; taken < length; taken++) {
        if (busy) {
            let pixel = ((u32(here.y) - top) * sweep.width + u32(here.x)) * sweep.lanes + lane;
            let cost = costs[pixel];
            let own = Reached(bytes_of(cost.x), bytes_of(cost.y));
            let before = here - way;
            var found = own;
            if (is_inside(before)) {
                let edge = u32(abs(grey_at(here) - grey_at(before)));
                let jump = max(sweep.small_step, sweep.large_step * EDGE / (EDGE + edge));
                found = extended(reached, own, i32(jump), taken % 2u * PATH_THREADS + thread, lane);
            }
            reached = Reached(select(beyond, found.low, low_counts), select(beyond, found.high, high_counts));
            let added = vec4u(
                pairs_of(select(vec4i(), found.low, low_counts)),
                pairs_of(select(vec4i(), found.high, high_counts)),
            );
            if (is_first != 0u) {
                totals[pixel] = added;
            } else {
                totals[pixel] += added;
            }
            last = here;
            here += way;
            if (down != 0) {
                here.x = wrapped(here.x);
            }
        }
        tell(reached, (taken + 1u) % 2u * PATH_THREADS + thread);
        workgroupBarrier();
    }
    if (busy && down != 0 && sweep.bands > 1u) {
        let place = 2u * (u32(last.x) * sweep.lanes + lane);
        carried_out[place] = reached.low;
        carried_out[place + 1u] = reached.high;
    }
}
