// Put together the rows of a table after a change: each copies the row before it that `row_sources` names, or becomes
// zeros where the name has its highest bit set. One thread per row.
import rows, workgroups

@group(0) @binding(0) var<uniform> rows: Rows;
@group(0) @binding(1) var<storage, read> row_sources: array<u32>;
@group(0) @binding(2) var<storage, read> table: array<f32>;
@group(0) @binding(3) var<storage, read_write> gathered: array<f32>;

const FRESH: u32 = 0x80000000u;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = folded(workgroup) * THREADS + thread;
    if (row >= rows.after) {
        return;
    }
    let source = row_sources[row] & ~FRESH;
    let cleared = rows.clears_fresh != 0u && (row_sources[row] & FRESH) != 0u;
    for (var column = 0u; column < rows.columns; column++) {
        gathered[column * rows.after + row] = select(table[column * rows.before + source], 0.0, cleared);
    }
}
