// For every descriptor of one image the nearest of another: the one with the largest product, since all have length 1.
// One workgroup per TILE descriptors, against all others ACROSS at a time, four of them for each thread.
import workgroups

struct Match {
    // Descriptors of either image.
    rows: u32,
    columns: u32,
}

// How the nearest is kept: its number, its product, and that of the next.
struct Nearest {
    number: u32,
    product: f32,
    next: f32,
}

@group(0) @binding(0) var<uniform> sizes: Match;
@group(0) @binding(1) var<storage, read> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read> columns: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> nearest: array<Nearest>;

// 1 to look for the nearest rows of columns.
override is_swapped: u32 = 0u;

const ACROSS: u32 = 4u * TILE;
// Of a descriptor, in fours; and how many of the others' are there at a time.
const SIZE: u32 = CELLS * CELLS * BINS / 4u;
const SLICE: u32 = SIZE / 8u;

var<workgroup> own: array<vec4f, TILE * SIZE>;
var<workgroup> others: array<vec4f, ACROSS * SLICE>;
var<workgroup> best: array<Nearest, THREADS>;

// The nearer of two, of equal ones the first, and the larger of the other products.
fn merged(a: Nearest, b: Nearest) -> Nearest {
    let is_first = a.product > b.product || (a.product == b.product && a.number < b.number);
    let next = max(max(a.next, b.next), min(a.product, b.product));
    return Nearest(select(b.number, a.number, is_first), select(b.product, a.product, is_first), next);
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let count = select(sizes.rows, sizes.columns, is_swapped == 1u);
    let against = select(sizes.columns, sizes.rows, is_swapped == 1u);
    let first = folded(workgroup) * TILE;
    if (first >= count) {
        return;
    }
    for (var place = thread; place < TILE * SIZE; place += THREADS) {
        own[place] = rows[min(first + place / SIZE, count - 1u) * SIZE + place % SIZE];
    }
    let row = thread / TILE;
    let column = thread % TILE;
    var found = Nearest(0u, -2.0, -2.0);
    for (var start = 0u; start < against; start += ACROSS) {
        var products = vec4f();
        for (var slice = 0u; slice < SIZE; slice += SLICE) {
            workgroupBarrier();
            for (var place = thread; place < ACROSS * SLICE; place += THREADS) {
                let other = min(start + place / SLICE, against - 1u);
                others[place] = columns[other * SIZE + slice + place % SLICE];
            }
            workgroupBarrier();
            for (var number = 0u; number < SLICE; number++) {
                let mine = own[row * SIZE + slice + number];
                let at = column * SLICE + number;
                products += vec4f(
                    dot(mine, others[at]),
                    dot(mine, others[at + TILE * SLICE]),
                    dot(mine, others[at + 2u * TILE * SLICE]),
                    dot(mine, others[at + 3u * TILE * SLICE]),
                );
            }
        }
        for (var part = 0u; part < 4u; part++) {
            let other = start + part * TILE + column;
            if (other < against) {
                found = merged(found, Nearest(other, products[part], -2.0));
            }
        }
    }
    best[thread] = found;
    for (var reach = TILE / 2u; reach > 0u; reach = reach / 2u) {
        workgroupBarrier();
        if (column < reach) {
            best[thread] = merged(best[thread], best[thread + reach]);
        }
    }
    if (column == 0u && first + row < count) {
        nearest[first + row] = best[thread];
    }
}
