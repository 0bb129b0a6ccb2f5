// The nearest points of every point, nearest first, and the mean distance to the first few besides itself. One thread
// per point.
import tree.points, workgroups

@group(0) @binding(0) var<uniform> cloud: Cloud;
@group(0) @binding(1) var<storage, read> positions: array<f32>;
@group(0) @binding(2) var<storage, read> boxes: array<Box>;
@group(0) @binding(3) var<storage, read_write> neighbours: array<u32>;
@group(0) @binding(4) var<storage, read_write> spacing: array<f32>;

// The nearest so far, and the squares of their distances.
var<private> nearest: array<u32, MOST_NEIGHBOURS>;
var<private> squares: array<f32, MOST_NEIGHBOURS>;

fn look_at(other: u32, own: vec3f) {
    let offset = position(other) - own;
    let square = dot(offset, offset);
    var place = cloud.neighbours - 1u;
    if (square >= squares[place]) {
        return;
    }
    while (place > 0u && squares[place - 1u] > square) {
        nearest[place] = nearest[place - 1u];
        squares[place] = squares[place - 1u];
        place--;
    }
    nearest[place] = other;
    squares[place] = square;
}

fn square_to(box: Box, own: vec3f) -> f32 {
    let gap = max(max(box.low - own, own - box.high), vec3f());
    return dot(gap, gap);
}

fn look_into(leaf: u32, own: vec3f) {
    for (var other = leaf * LEAF; other < min((leaf + 1u) * LEAF, cloud.points); other++) {
        look_at(other, own);
    }
}

// The box after one and all within it: the right half of the smallest box that has it in its left half.
fn next(number: u32) -> u32 {
    return (number + 1u) >> countTrailingZeros(number + 1u);
}

// Look into a box, but not where nothing can be nearer than what is known.
fn search(whole: u32, own: vec3f) {
    var number = whole;
    loop {
        let is_near = square_to(boxes[number], own) < squares[cloud.neighbours - 1u];
        if (is_near && number < cloud.leaves) {
            number = 2u * number;
            continue;
        }
        if (is_near) {
            look_into(number - cloud.leaves, own);
        }
        number = next(number);
        if (number == next(whole)) {
            break;
        }
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let point = folded(workgroup) * THREADS + thread;
    if (point >= cloud.points) {
        return;
    }
    for (var place = 0u; place < MOST_NEIGHBOURS; place++) {
        squares[place] = FAR;
    }
    // From the point's leaf up, each time into the half beside: what is near is found first, and most else passed over.
    let own = position(point);
    look_into(point / LEAF, own);
    for (var number = cloud.leaves + point / LEAF; number > 1u; number = number / 2u) {
        search(number ^ 1u, own);
    }
    for (var place = 0u; place < cloud.neighbours; place++) {
        neighbours[point * MOST_NEIGHBOURS + place] = nearest[place];
    }
    var sum = 0.0;
    for (var place = 1u; place <= SPACING_NEIGHBOURS; place++) {
        sum += sqrt(squares[place]);
    }
    spacing[point] = sum / f32(SPACING_NEIGHBOURS);
}
