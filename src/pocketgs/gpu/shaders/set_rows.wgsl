// Set some columns of the rows of a table that `listed_rows` names. One thread per row.
import rows, workgroups

@group(0) @binding(0) var<uniform> rows: Rows;
@group(0) @binding(1) var<storage, read> listed_rows: array<u32>;
@group(0) @binding(2) var<storage, read> listed_values: array<f32>;
@group(0) @binding(3) var<storage, read_write> table: array<f32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let place = folded(workgroup) * THREADS + thread;
    if (place >= rows.listed) {
        return;
    }
    for (var column = 0u; column < rows.columns; column++) {
        let value = listed_values[place * rows.columns + column];
        table[(rows.first_column + column) * rows.after + listed_rows[place]] = value;
    }
}
