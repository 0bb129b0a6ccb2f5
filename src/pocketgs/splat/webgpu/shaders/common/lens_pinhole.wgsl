// No lens: (x, y, z) ↦ (fx x/z + cx, fy y/z + cy).
import lens

fn depth_of(local: vec3f) -> f32 {
    return local.z;
}

// Whether a Gaussian beside the image stays clear of the camera's plane by a standard deviation. Otherwise no ellipse is
// its image, and the linearised projection would draw it as a veil.
fn is_shown(view: View, local: vec3f, largest_scale: f32) -> bool {
    let slopes = local.xy / local.z;
    let is_beside = any(slopes < view.slopes_low) || any(slopes > view.slopes_high);
    return !(is_beside && largest_scale > local.z);
}

fn project_point(view: View, local: vec3f) -> vec2f {
    return view.focal * local.xy / local.z + view.principal;
}

fn jacobian_at(view: View, local: vec3f) -> Jacobian {
    // Clamped to the image and a margin: far outside it the linearisation explodes.
    let slopes = clamp(local.xy / local.z, view.slopes_low, view.slopes_high);
    return Jacobian(
        vec3f(view.focal.x / local.z, 0.0, -view.focal.x * slopes.x / local.z),
        vec3f(0.0, view.focal.y / local.z, -view.focal.y * slopes.y / local.z),
    );
}

section backward
// Gradient with respect to the camera-space position, from the projected centre and from the Jacobian.
fn position_backward(view: View, local: vec3f, jacobian: Jacobian, d_mean: vec2f, d_jacobian: Jacobian) -> vec3f {
    let z = local.z;
    let slopes = local.xy / z;
    let free = (slopes >= view.slopes_low) & (slopes <= view.slopes_high);
    var d = vec3f(d_mean * view.focal / z, 0.0);
    d.z = -(dot(d.xy, local.xy) + jacobian.x.x * d_jacobian.x.x + jacobian.y.y * d_jacobian.y.y) / z;
    // ∂x/∂x = fx/z and ∂x/∂z = -fx x/z², or -fx · limit/z where clamped.
    d.x -= select(0.0, jacobian.x.x / z * d_jacobian.x.z, free.x);
    d.y -= select(0.0, jacobian.y.y / z * d_jacobian.y.z, free.y);
    d.z -= select(1.0, 2.0, free.x) * jacobian.x.z / z * d_jacobian.x.z;
    d.z -= select(1.0, 2.0, free.y) * jacobian.y.z / z * d_jacobian.y.z;
    return d;
}
