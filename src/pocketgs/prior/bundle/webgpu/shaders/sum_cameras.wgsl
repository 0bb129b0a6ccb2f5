// A camera's part of the equations, over its observations: products of derivatives with each other and with the residual;
// and what eliminating the points takes from the right-hand side. One thread per camera and sum.
import reprojection, blocks.point, blocks.sight, blocks.eliminated, workgroups

// A camera's observations and their points lie side by side in `seen`.
@group(0) @binding(1) var<storage, read> camera_starts: array<u32>;
@group(0) @binding(2) var<storage, read> seen: array<vec2u>;
@group(0) @binding(3) var<storage, read> point_blocks: array<f32>;
@group(0) @binding(4) var<storage, read> sights: array<f32>;
@group(0) @binding(5) var<storage, read> eliminated: array<f32>;
@group(0) @binding(6) var<storage, read_write> camera_sums: array<f32>;

const PRODUCTS: u32 = CAMERA_UNKNOWNS * COLUMNS;

fn sum_of_products(camera: u32, a: u32, b: u32) -> f32 {
    var sum = 0.0;
    for (var k = camera_starts[camera]; k < camera_starts[camera + 1u]; k++) {
        let row = SIGHT_WORDS * seen[k].x;
        sum += sights[row + OF_X + a] * sights[row + OF_X + b] + sights[row + OF_Y + a] * sights[row + OF_Y + b];
    }
    return sum;
}

fn sum_of_eliminated(camera: u32, a: u32) -> f32 {
    var sum = 0.0;
    for (var k = camera_starts[camera]; k < camera_starts[camera + 1u]; k++) {
        sum += dot(eliminated_of(seen[k].x, a), vector_of(seen[k].y, GRADIENT));
    }
    return sum;
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let place = folded(workgroup) * THREADS + thread;
    let camera = place / CAMERA_SUMS;
    if (camera >= adjustment.cameras) {
        return;
    }
    let which = place % CAMERA_SUMS;
    if (which < PRODUCTS) {
        camera_sums[place] = sum_of_products(camera, which / COLUMNS, which % COLUMNS);
    } else {
        camera_sums[place] = sum_of_eliminated(camera, which - PRODUCTS);
    }
}
