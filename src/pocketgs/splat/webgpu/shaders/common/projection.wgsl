// The projection of a Gaussian and its linearisation (EWA splatting, Zwicker et al. 2002, section 6). Other camera
// models would replace this file.

// The derivative of a pinhole projection: rows (xx, 0, xz) and (0, yy, yz).
struct Jacobian {
    xx: f32,
    xz: f32,
    yy: f32,
    yz: f32,
}

// x/z and y/z, clamped to the image and a margin: far outside it the linearisation explodes.
fn clamped_slopes(view: View, local: vec3f) -> vec2f {
    return clamp(local.xy / local.z, view.slopes_low, view.slopes_high);
}

// Whether a Gaussian beside the image reaches the camera's plane within a standard deviation. No ellipse is its image,
// and the linearised projection would draw it as a veil.
fn is_veil(view: View, local: vec3f, scale: vec3f) -> bool {
    let slopes = local.xy / local.z;
    let is_beside = any(slopes < view.slopes_low) || any(slopes > view.slopes_high);
    return is_beside && max(scale.x, max(scale.y, scale.z)) > local.z;
}

fn jacobian_at(view: View, local: vec3f) -> Jacobian {
    let slopes = clamped_slopes(view, local);
    return Jacobian(
        view.focal.x / local.z,
        -view.focal.x * slopes.x / local.z,
        view.focal.y / local.z,
        -view.focal.y * slopes.y / local.z,
    );
}

fn project_vector(jacobian: Jacobian, a: vec3f) -> vec2f {
    return vec2f(jacobian.xx * a.x + jacobian.xz * a.z, jacobian.yy * a.y + jacobian.yz * a.z);
}

// The covariance in the image, J W Σ Wᵀ Jᵀ.
struct Footprint {
    xx: f32,
    xy: f32,
    yy: f32,
    determinant: f32,
}

fn footprint_of(view: View, gaussian: Gaussian, jacobian: Jacobian) -> Footprint {
    let axes = axes_of(gaussian.quaternion);
    let scale = exp(gaussian.log_scale);
    let p = project_vector(jacobian, rotate_to_camera(view, scale.x * axes[0]));
    let q = project_vector(jacobian, rotate_to_camera(view, scale.y * axes[1]));
    let r = project_vector(jacobian, rotate_to_camera(view, scale.z * axes[2]));
    // xx yy - xy² as a sum of squares (Cauchy and Binet), which float32 can hold for needles too.
    let minors = vec3f(p.x * q.y - p.y * q.x, p.x * r.y - p.y * r.x, q.x * r.y - q.y * r.x);
    return Footprint(
        p.x * p.x + q.x * q.x + r.x * r.x,
        p.x * p.y + q.x * q.y + r.x * r.y,
        p.y * p.y + q.y * q.y + r.y * r.y,
        dot(minors, minors),
    );
}

fn project_point(view: View, local: vec3f) -> vec2f {
    return view.focal * local.xy / local.z + view.principal;
}
