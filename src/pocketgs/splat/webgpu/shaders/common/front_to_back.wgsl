// What the compositing rules have in common that take splats front to back until a pixel is full.

section start
// What a pixel has gathered at first is no colour and the transmittance, which is 0 beside the image.
fn nothing_yet(inside: bool) -> vec4f {
    return vec4f(vec3f(), select(0.0, 1.0, inside));
}

section forward
import front_to_back.start

// Whether a pixel takes more splats.
fn takes_more(gathered: vec4f) -> bool {
    return gathered.a >= TRANSMITTANCE_MIN;
}

section backward
// The gradient by replaying in the same order. With D_i = c_i · ∂L/∂C, what lies behind splat i enters its gradient
// only through the number H_i = Σ_{j>i} w_j D_j + T (background · ∂L/∂C + ∂L/∂T). It starts at C · ∂L/∂C + T ∂L/∂T,
// with the finished pixel's C and T, and loses w_i D_i at every contribution. T and H are all that a replay carries.
fn first_behind(pixel: vec4f, d_pixel: vec4f) -> f32 {
    return dot(pixel, d_pixel);
}

fn rest_behind(behind: f32, gain: f32) -> f32 {
    return behind - gain;
}
