// The plane through every point's nearest points: its normal, and the direction in which they spread most. These are
// eigenvectors of the points' covariance, found by Jacobi's rotations (Golub and Van Loan, section 8.5). One thread per
// point.
import tree.points, workgroups

@group(0) @binding(0) var<uniform> cloud: Cloud;
@group(0) @binding(1) var<storage, read> positions: array<f32>;
@group(0) @binding(2) var<storage, read> neighbours: array<u32>;
@group(0) @binding(3) var<storage, read_write> normals: array<f32>;
@group(0) @binding(4) var<storage, read_write> tangents: array<f32>;

const SWEEPS: u32 = 6u;

// Of a matrix whose largest entry is about 1: less than rounding leaves.
const NEGLIGIBLE: f32 = 1e-12;

// Neighbours relative to the point, so that nothing is lost far from the origin.
fn offset(point: u32, place: u32) -> vec3f {
    return position(neighbours[point * MOST_NEIGHBOURS + place]) - position(point);
}

// The covariance, in units of the square of the farthest neighbour's distance.
fn covariance(point: u32) -> mat3x3f {
    let count = f32(cloud.neighbours);
    let farthest = length(offset(point, cloud.neighbours - 1u));
    let unit = select(farthest, 1.0, farthest == 0.0);
    var mean = vec3f();
    for (var place = 0u; place < cloud.neighbours; place++) {
        mean += offset(point, place) / (unit * count);
    }
    var sum = mat3x3f();
    for (var place = 0u; place < cloud.neighbours; place++) {
        let away = offset(point, place) / unit - mean;
        sum += mat3x3f(away * away.x, away * away.y, away * away.z);
    }
    return sum * (1.0 / count);
}

// Cosine and sine of the angle by which a plane is turned so that nothing is left in `mixed`, its entry between two axes.
fn turn(first: f32, mixed: f32, second: f32) -> vec2f {
    if (abs(mixed) < NEGLIGIBLE) {
        return vec2f(1.0, 0.0);
    }
    let slope = (second - first) / (2.0 * mixed);
    let tangent = select(-1.0, 1.0, slope >= 0.0) / (abs(slope) + sqrt(slope * slope + 1.0));
    let cosine = inverseSqrt(tangent * tangent + 1.0);
    return vec2f(cosine, tangent * cosine);
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
    var a = covariance(point);
    var axes = mat3x3f(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    for (var sweep = 0u; sweep < SWEEPS; sweep++) {
        let xy = turn(a[0].x, a[0].y, a[1].y);
        let about_z = mat3x3f(xy.x, -xy.y, 0.0, xy.y, xy.x, 0.0, 0.0, 0.0, 1.0);
        a = transpose(about_z) * a * about_z;
        let xz = turn(a[0].x, a[0].z, a[2].z);
        let about_y = mat3x3f(xz.x, 0.0, -xz.y, 0.0, 1.0, 0.0, xz.y, 0.0, xz.x);
        a = transpose(about_y) * a * about_y;
        let yz = turn(a[1].y, a[1].z, a[2].z);
        let about_x = mat3x3f(1.0, 0.0, 0.0, 0.0, yz.x, -yz.y, 0.0, yz.y, yz.x);
        a = transpose(about_x) * a * about_x;
        axes = axes * about_z * about_y * about_x;
    }
    let spread = vec3f(a[0].x, a[1].y, a[2].z);
    var least = 0u;
    var most = 0u;
    for (var axis = 1u; axis < 3u; axis++) {
        least = select(least, axis, spread[axis] < spread[least]);
        most = select(most, axis, spread[axis] >= spread[most]);
    }
    let normal = normalize(axes[least]);
    let tangent = normalize(axes[most]);
    for (var axis = 0u; axis < 3u; axis++) {
        normals[3u * point + axis] = normal[axis];
        tangents[3u * point + axis] = tangent[axis];
    }
}
