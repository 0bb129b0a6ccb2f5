// What all lenses share. `lens_pinhole.wgsl`, `lens_perspective.wgsl`, `lens_fisheye.wgsl` and `lens_orthographic.wgsl`
// have the formulas of one model each, under the same names; `splat/cpu/lenses` has them too, and says where they come
// from.

// Written where a camera has a lens.
struct Lens {
    // k1, k2, p1, p2, then k3 to k6, then s1 to s4; of a fisheye, the first holds k1 to k4.
    first: vec4f,
    second: vec4f,
    third: vec4f,
    // Largest angle off axis that the lens shows, in radians.
    largest_angle: f32,
    // The square of the largest slope that it shows, or a fisheye's least cosine.
    bound: f32,
    // Least distance from the principal point for each radian off axis, in focal lengths.
    least_radius: f32,
    // Largest length on the image plane of a unit of length at depth 1.
    stretch: f32,
}

@group(0) @binding(1) var<uniform> lens: Lens;

// The derivative of a pixel's x and y with respect to the position in camera space.
struct Jacobian {
    x: vec3f,
    y: vec3f,
}

fn project_vector(jacobian: Jacobian, a: vec3f) -> vec2f {
    return vec2f(dot(jacobian.x, a), dot(jacobian.y, a));
}
