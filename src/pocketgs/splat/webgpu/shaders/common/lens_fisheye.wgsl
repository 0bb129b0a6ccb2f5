// A fisheye: (x, y, z) ↦ f s (x, y) + c with s = θ P(θ²)/r, r² = x² + y² and θ = atan2(r, z), where
// P(w) = 1 + k1 w + k2 w² + k3 w³ + k4 w⁴ (Kannala and Brandt 2006). s depends on x and y only through r: ∂s/∂x = A x and
// ∂s/∂z = B; the derivatives of A are C x and E, those of B are E x and F.
import lens

// Quotients by r use a power series if (r/z)² is less than this.
const NEAR_AXIS: f32 = 0.01;

// The distance: z does not order points beside and behind the image plane.
fn depth_of(local: vec3f) -> f32 {
    return length(local);
}

fn is_shown(view: View, local: vec3f, largest_scale: f32) -> bool {
    return local.z >= lens.bound * length(local);
}

// atan2(y, x) for y >= 0, not both 0. WGSL allows its own an error of 4,096 units in the last place.
fn angle_of(y: f32, x: f32) -> f32 {
    let is_steep = abs(x) < y;
    let t = select(y, abs(x), is_steep) / select(abs(x), y, is_steep);
    let u = t * t;
    var sum = ARCTANGENT[ARCTANGENT_TERMS - 1u];
    for (var k = ARCTANGENT_TERMS - 1u; k > 0u; k--) {
        sum = ARCTANGENT[k - 1u] + u * sum;
    }
    let found = select(t * sum, RIGHT_ANGLE - t * sum, is_steep);
    return select(found, 2.0 * RIGHT_ANGLE - found, x < 0.0);
}

const RIGHT_ANGLE: f32 = 1.5707964;

// θ/r and, for a lens without coefficients, A and C, from q = r².
fn equidistant(q: f32, z: f32) -> vec3f {
    let t = q / (z * z);
    if (z >= 0.0 && t < NEAR_AXIS) {
        return vec3f(
            1.0 - t * (1.0 / 3.0 - t * (1.0 / 5.0 - t * (1.0 / 7.0 - t * (1.0 / 9.0 - t / 11.0)))),
            (-2.0 / 3.0 + t * (4.0 / 5.0 - t * (6.0 / 7.0 - t * (8.0 / 9.0 - t * 10.0 / 11.0)))) / (z * z),
            (8.0 / 5.0 - t * (24.0 / 7.0 - t * (16.0 / 3.0 - t * 80.0 / 11.0))) / (z * z * z * z),
        ) / z;
    }
    let r = sqrt(q);
    let square = q + z * z;
    let s = angle_of(r, z) / r;
    let a = (z / square - s) / q;
    return vec3f(s, a, (-2.0 * z / (square * square) - 3.0 * a) / q);
}

struct Derivatives {
    s: f32,
    a: f32,
    b: f32,
    c: f32,
    e: f32,
    f: f32,
}

fn derivatives_at(local: vec3f) -> Derivatives {
    let k = lens.first;
    let z = local.z;
    let q = dot(local.xy, local.xy);
    let square = q + z * z;
    let plain = equidistant(q, z);
    let s = plain.x;
    let w = s * s * q;
    let p = 1.0 + w * (k.x + w * (k.y + w * (k.z + w * k.w)));
    let p1 = k.x + w * (2.0 * k.y + w * (3.0 * k.z + w * 4.0 * k.w));
    let p2 = 2.0 * k.y + w * (6.0 * k.z + w * 12.0 * k.w);
    // With g(θ) = θ P(θ²), g' and g''/r.
    let slope = p + 2.0 * w * p1;
    let bend = s * (6.0 * p1 + 4.0 * w * p2);
    let turn = s * z / square;
    return Derivatives(
        s * p,
        plain.y * p + 2.0 * s * turn * p1,
        -slope / square,
        plain.z * p + turn * (6.0 * plain.y - 4.0 * s / square) * p1 + 4.0 * s * turn * turn * p2,
        (2.0 * slope - z * bend) / (square * square),
        (2.0 * slope * z + bend * q) / (square * square),
    );
}

fn project_point(view: View, local: vec3f) -> vec2f {
    return view.focal * derivatives_at(local).s * local.xy + view.principal;
}

fn jacobian_at(view: View, local: vec3f) -> Jacobian {
    let d = derivatives_at(local);
    let x = local.x;
    let y = local.y;
    return Jacobian(
        view.focal.x * vec3f(d.s + d.a * x * x, d.a * x * y, d.b * x),
        view.focal.y * vec3f(d.a * x * y, d.s + d.a * y * y, d.b * y),
    );
}

section backward
// Gradient with respect to the camera-space position, from the projected centre and from the Jacobian.
fn position_backward(view: View, local: vec3f, jacobian: Jacobian, d_mean: vec2f, d_jacobian: Jacobian) -> vec3f {
    let d = derivatives_at(local);
    let at = local.xy;
    let d_x = d_jacobian.x * view.focal.x;
    let d_y = d_jacobian.y * view.focal.y;
    let mixed = d_x.y + d_y.x;
    let squares = vec2f(d_x.x, d_y.y);
    let d_s = d_x.x + d_y.y;
    let d_a = dot(squares, at * at) + mixed * at.x * at.y;
    let d_b = d_x.z * at.x + d_y.z * at.y;
    let across = (d_s * d.a + d_a * d.c + d_b * d.e) * at + d.a * (2.0 * squares * at + mixed * at.yx)
        + d.b * vec2f(d_x.z, d_y.z);
    return jacobian.x * d_mean.x + jacobian.y * d_mean.y + vec3f(across, d_s * d.b + d_a * d.e + d_b * d.f);
}
