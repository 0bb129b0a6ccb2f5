// No dimension of a dispatch may exceed 65,535 workgroups, so long ones are folded into rows of equal length.
const LONGEST_ROW: u32 = 65535u;

fn folded(workgroup: vec3u, groups: vec3u) -> u32 {
    return workgroup.y * groups.x + workgroup.x;
}
