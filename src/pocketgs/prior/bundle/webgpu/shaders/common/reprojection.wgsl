// Reprojection errors and their derivatives, as in `bundle/reprojection.py`. Positions are relative to the middle of the
// cameras, in units of the scene's size, and pixels to the principal point.

struct Adjustment {
    cameras: u32,
    points: u32,
    // Of cameras that see a point in common.
    pairs: u32,
    // Length in pixels above which the loss of a residual is linear.
    huber: f32,
    // The point blocks' diagonals grow by this factor of themselves.
    damping: f32,
}

@group(0) @binding(0) var<uniform> adjustment: Adjustment;

struct Camera {
    rotation: mat3x3f,
    centre: vec3f,
    focal: vec2f,
}

// An observation's residual and its derivatives, weighted by the Huber loss: by the camera's rotation and by the point.
// Those by the camera's centre are those by the point, with the other sign.
struct Linearised {
    residual: vec2f,
    turn: array<vec3f, 2>,
    point: array<vec3f, 2>,
}

// All 0 for a point that is not in front of the camera.
fn linearised(camera: Camera, position: vec3f, pixel: vec2f) -> Linearised {
    var found: Linearised;
    let local = camera.rotation * (position - camera.centre);
    if (!(local.z > GRAZING * length(local))) {
        return found;
    }
    let at = local.xy / local.z;
    let residual = camera.focal * at - pixel;
    // Iteratively reweighted least squares: both are multiplied by the root of min(1, huber / |r|).
    let root = sqrt(min(1.0, adjustment.huber / max(length(residual), 1e-30)));
    let focal = root * camera.focal;
    found.residual = root * residual;
    for (var axis = 0u; axis < 2u; axis++) {
        // By the point in camera axes. A rotation ω moves it by ω × local, and g · (ω × local) = ω · (local × g).
        var gradient = vec3f(0.0, 0.0, -at[axis]);
        gradient[axis] = 1.0;
        gradient *= focal[axis] / local.z;
        found.turn[axis] = cross(local, gradient);
        found.point[axis] = gradient * camera.rotation;
    }
    return found;
}

section camera
// Row i of `cameras`, which the pass binds: the rotation's rows, the centre, the focal lengths.
fn read_camera(i: u32) -> Camera {
    let row = CAMERA_WORDS * i;
    let rows = mat3x3f(
        vec3f(cameras[row], cameras[row + 1u], cameras[row + 2u]),
        vec3f(cameras[row + 3u], cameras[row + 4u], cameras[row + 5u]),
        vec3f(cameras[row + 6u], cameras[row + 7u], cameras[row + 8u]),
    );
    return Camera(
        transpose(rows),
        vec3f(cameras[row + 9u], cameras[row + 10u], cameras[row + 11u]),
        vec2f(cameras[row + 12u], cameras[row + 13u]),
    );
}
