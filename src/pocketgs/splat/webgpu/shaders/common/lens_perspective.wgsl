// OpenCV's lens: (x, y, z) ↦ f d(x/z, y/z) + c, where d has radial, tangential and thin-prism distortion:
// with q = x² + y², d = (x R(q) + 2 p1 x y + p2 (q + 2 x²) + s1 q + s2 q², y R(q) + p1 (q + 2 y²) + 2 p2 x y + s3 q +
// s4 q²).
import lens

fn depth_of(local: vec3f) -> f32 {
    return local.z;
}

// As of a pinhole, and within the angle up to which the lens is one-to-one.
fn is_shown(view: View, local: vec3f, largest_scale: f32) -> bool {
    let slopes = local.xy / local.z;
    let is_beside = any(slopes < view.slopes_low) || any(slopes > view.slopes_high);
    return dot(slopes, slopes) <= lens.bound && !(is_beside && largest_scale > local.z);
}

// R(q) and its first two derivatives.
fn radial(q: f32) -> vec3f {
    let k = vec3f(lens.first.xy, lens.second.x);
    let l = lens.second.yzw;
    let lower = 1.0 + q * (l.x + q * (l.y + q * l.z));
    let lower1 = l.x + q * (2.0 * l.y + q * 3.0 * l.z);
    let lower2 = 2.0 * l.y + q * 6.0 * l.z;
    let value = (1.0 + q * (k.x + q * (k.y + q * k.z))) / lower;
    let slope = (k.x + q * (2.0 * k.y + q * 3.0 * k.z) - value * lower1) / lower;
    return vec3f(value, slope, (2.0 * k.y + q * 6.0 * k.z - 2.0 * slope * lower1 - value * lower2) / lower);
}

// p1 and p2; s1 and s3, of q; s2 and s4, of q².
fn tangential() -> vec2f {
    return lens.first.zw;
}

fn prism() -> vec2f {
    return lens.third.xz;
}

fn prism2() -> vec2f {
    return lens.third.yw;
}

fn project_point(view: View, local: vec3f) -> vec2f {
    let p = tangential();
    let at = local.xy / local.z;
    let q = dot(at, at);
    let mixed = 2.0 * at.x * at.y;
    let shown = at * radial(q).x + mixed * p + p.yx * (q + 2.0 * at * at) + q * (prism() + q * prism2());
    return view.focal * shown + view.principal;
}

// ∂d/∂(x, y): rows of d's x and y.
fn distortion_slopes(at: vec2f) -> array<vec2f, 2> {
    let p = tangential();
    let q = dot(at, at);
    let r = radial(q);
    let along = at * r.y + prism() + 2.0 * q * prism2();
    let mixed = 2.0 * dot(p, at);
    return array<vec2f, 2>(
        vec2f(r.x + 2.0 * at.x * along.x + 2.0 * (p.x * at.y + 3.0 * p.y * at.x), 2.0 * at.y * along.x + mixed),
        vec2f(2.0 * at.x * along.y + mixed, r.x + 2.0 * at.y * along.y + 2.0 * (3.0 * p.x * at.y + p.y * at.x)),
    );
}

// x/z and y/z, clamped to the image and a margin: far outside it the linearisation explodes.
fn held_slopes(view: View, local: vec3f) -> vec2f {
    return clamp(local.xy / local.z, view.slopes_low, view.slopes_high);
}

fn jacobian_at(view: View, local: vec3f) -> Jacobian {
    let at = held_slopes(view, local);
    let slopes = distortion_slopes(at);
    let scale = view.focal / local.z;
    return Jacobian(
        scale.x * vec3f(slopes[0], -dot(slopes[0], at)),
        scale.y * vec3f(slopes[1], -dot(slopes[1], at)),
    );
}

section backward
// Gradient with respect to (x, y) from that with respect to the rows of `distortion_slopes`.
fn slopes_backward(at: vec2f, d_x: vec2f, d_y: vec2f) -> vec2f {
    let p = tangential();
    let q = dot(at, at);
    let r = radial(q);
    // What d's second derivatives have in common: of x² and y², and of x y.
    let bend = at * r.z + 2.0 * prism2();
    let even = 2.0 * (at * r.y + prism() + 2.0 * q * prism2());
    let square = 4.0 * at * at;
    let product = 4.0 * at.x * at.y;
    let x_xx = 4.0 * at.x * r.y + square.x * bend.x + even.x + 6.0 * p.y;
    let x_xy = 2.0 * at.y * r.y + product * bend.x + 2.0 * p.x;
    let x_yy = square.y * bend.x + even.x + 2.0 * p.y;
    let y_xx = square.x * bend.y + even.y + 2.0 * p.x;
    let y_xy = 2.0 * at.x * r.y + product * bend.y + 2.0 * p.y;
    let y_yy = 4.0 * at.y * r.y + square.y * bend.y + even.y + 6.0 * p.x;
    return d_x.x * vec2f(x_xx, x_xy) + d_x.y * vec2f(x_xy, x_yy) + d_y.x * vec2f(y_xx, y_xy)
        + d_y.y * vec2f(y_xy, y_yy);
}

// Gradient with respect to the camera-space position, from the projected centre and from the Jacobian.
fn position_backward(view: View, local: vec3f, jacobian: Jacobian, d_mean: vec2f, d_jacobian: Jacobian) -> vec3f {
    let z = local.z;
    let slopes = local.xy / z;
    let rows = distortion_slopes(slopes);
    let d_point = d_mean * view.focal;
    var d_slopes = rows[0] * d_point.x + rows[1] * d_point.y;
    let at = held_slopes(view, local);
    // Columns x and y of the Jacobian are f D/z with D = ∂d/∂(x/z, y/z), and column z is -(column x · x/z + column y ·
    // y/z).
    let e_x = d_jacobian.x.xy - at * d_jacobian.x.z;
    let e_y = d_jacobian.y.xy - at * d_jacobian.y.z;
    let scale = view.focal / z;
    let through = slopes_backward(at, scale.x * e_x, scale.y * e_y)
        - jacobian.x.xy * d_jacobian.x.z - jacobian.y.xy * d_jacobian.y.z;
    d_slopes += select(vec2f(), through, at == slopes);
    let d_z = dot(e_x, jacobian.x.xy) + dot(e_y, jacobian.y.xy) + dot(d_slopes, slopes);
    return vec3f(d_slopes, -d_z) / z;
}
