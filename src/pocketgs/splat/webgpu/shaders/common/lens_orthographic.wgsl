// Parallel rays: (x, y, z) ↦ (fx x + cx, fy y + cy), with focal lengths in pixels per unit.
import lens

fn depth_of(local: vec3f) -> f32 {
    return local.z;
}

fn is_shown(view: View, local: vec3f, largest_scale: f32) -> bool {
    return local.z > 0.0;
}

fn project_point(view: View, local: vec3f) -> vec2f {
    return view.focal * local.xy + view.principal;
}

fn jacobian_at(view: View, local: vec3f) -> Jacobian {
    return Jacobian(vec3f(view.focal.x, 0.0, 0.0), vec3f(0.0, view.focal.y, 0.0));
}

section backward
// The Jacobian is constant: gradients come from the projected centre alone.
fn position_backward(view: View, local: vec3f, jacobian: Jacobian, d_mean: vec2f, d_jacobian: Jacobian) -> vec3f {
    return vec3f(view.focal * d_mean, 0.0);
}
