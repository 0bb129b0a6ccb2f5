// Real spherical harmonics up to degree 3, in the order and with the signs of the reference 3DGS .ply.
const C0: f32 = 0.28209479177387814;
const C1: f32 = 0.4886025119029199;
const C2: array<f32, 5> = array<f32, 5>(
    1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396,
);
const C3: array<f32, 7> = array<f32, 7>(
    -0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154, -0.4570457994644658,
    1.445305721320277, -0.5900435899266435,
);

// Value of harmonic k at the unit vector d.
fn harmonic(k: u32, d: vec3f) -> f32 {
    let s = d * d;
    switch k {
        case 0u: { return C0; }
        case 1u: { return -C1 * d.y; }
        case 2u: { return C1 * d.z; }
        case 3u: { return -C1 * d.x; }
        case 4u: { return C2[0] * d.x * d.y; }
        case 5u: { return C2[1] * d.y * d.z; }
        case 6u: { return C2[2] * (2.0 * s.z - s.x - s.y); }
        case 7u: { return C2[3] * d.x * d.z; }
        case 8u: { return C2[4] * (s.x - s.y); }
        case 9u: { return C3[0] * d.y * (3.0 * s.x - s.y); }
        case 10u: { return C3[1] * d.x * d.y * d.z; }
        case 11u: { return C3[2] * d.y * (4.0 * s.z - s.x - s.y); }
        case 12u: { return C3[3] * d.z * (2.0 * s.z - 3.0 * s.x - 3.0 * s.y); }
        case 13u: { return C3[4] * d.x * (4.0 * s.z - s.x - s.y); }
        case 14u: { return C3[5] * d.z * (s.x - s.y); }
        default: { return C3[6] * d.x * (s.x - 3.0 * s.y); }
    }
}

section gradient
// Derivative of harmonic k along x, y and z taken as independent.
fn harmonic_gradient(k: u32, d: vec3f) -> vec3f {
    let s = d * d;
    switch k {
        case 0u: { return vec3f(); }
        case 1u: { return vec3f(0.0, -C1, 0.0); }
        case 2u: { return vec3f(0.0, 0.0, C1); }
        case 3u: { return vec3f(-C1, 0.0, 0.0); }
        case 4u: { return C2[0] * vec3f(d.y, d.x, 0.0); }
        case 5u: { return C2[1] * vec3f(0.0, d.z, d.y); }
        case 6u: { return 2.0 * C2[2] * vec3f(-d.x, -d.y, 2.0 * d.z); }
        case 7u: { return C2[3] * vec3f(d.z, 0.0, d.x); }
        case 8u: { return 2.0 * C2[4] * vec3f(d.x, -d.y, 0.0); }
        case 9u: { return 3.0 * C3[0] * vec3f(2.0 * d.x * d.y, s.x - s.y, 0.0); }
        case 10u: { return C3[1] * vec3f(d.y * d.z, d.x * d.z, d.x * d.y); }
        case 11u: { return C3[2] * vec3f(-2.0 * d.x * d.y, 4.0 * s.z - s.x - 3.0 * s.y, 8.0 * d.y * d.z); }
        case 12u: { return 3.0 * C3[3] * vec3f(-2.0 * d.x * d.z, -2.0 * d.y * d.z, 2.0 * s.z - s.x - s.y); }
        case 13u: { return C3[4] * vec3f(4.0 * s.z - 3.0 * s.x - s.y, -2.0 * d.x * d.y, 8.0 * d.x * d.z); }
        case 14u: { return C3[5] * vec3f(2.0 * d.x * d.z, -2.0 * d.y * d.z, s.x - s.y); }
        default: { return 3.0 * C3[6] * vec3f(s.x - s.y, -2.0 * d.x * d.y, 0.0); }
    }
}
