// The covariance of a Gaussian in the image, J W Σ Wᵀ Jᵀ (EWA splatting, Zwicker et al. 2002, section 6).
import lens.kind, gaussians, view

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
