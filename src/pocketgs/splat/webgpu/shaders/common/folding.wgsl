// No dimension of a dispatch may exceed LONGEST_ROW workgroups, so long ones are folded into rows of that length.
fn folded(workgroup: vec3u) -> u32 {
    return workgroup.y * LONGEST_ROW + workgroup.x;
}
