// Plan what follows from the number of intersections: how many workgroups walk over them. One thread.
import view, update.status, ranks, workgroups

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> first_slots: array<u32>;
@group(0) @binding(2) var<storage, read> gaussian_count: array<u32>;
@group(0) @binding(3) var<storage, read_write> status: array<u32>;
@group(0) @binding(4) var<storage, read_write> intersection_count: array<u32>;
@group(0) @binding(5) var<storage, read_write> intersection_dispatches: array<u32>;

// Write the dispatch of `groups` workgroups, folded.
fn write_dispatch(place: u32, groups: u32) {
    let rows = (groups + MAX_ROW_LENGTH - 1u) / MAX_ROW_LENGTH;
    intersection_dispatches[place] = min(groups, MAX_ROW_LENGTH);
    intersection_dispatches[place + 1u] = rows;
    intersection_dispatches[place + 2u] = 1u;
}

@compute @workgroup_size(1)
fn main() {
    let needed = first_slots[gaussian_count[0]];
    if (needed > view.intersection_capacity) {
        status[HALTED] = 1u;
    }
    status[NEEDED] = max(status[NEEDED], needed);
    let halted = status[HALTED] != 0u;
    let intersections = select(needed, 0u, halted);
    intersection_count[INTERSECTIONS] = intersections;
    intersection_count[RANKS] = select(gaussian_count[0], 0u, halted);
    write_dispatch(0u, (intersections + BLOCK - 1u) / BLOCK);
    write_dispatch(3u, (intersections + THREADS - 1u) / THREADS);
}
