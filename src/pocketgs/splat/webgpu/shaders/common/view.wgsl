// One image to draw: the camera, the image's size, and how much there is to draw. Written anew for every image.
struct View {
    // Rows of world_to_camera: rotation and translation.
    to_camera_x: vec4f,
    to_camera_y: vec4f,
    to_camera_z: vec4f,
    // Of the camera, in the world.
    centre: vec4f,
    background: vec4f,
    focal: vec2f,
    principal: vec2f,
    // Least and largest x/z and y/z at which the projection's Jacobian is evaluated.
    slopes_low: vec2f,
    slopes_high: vec2f,
    width: u32,
    height: u32,
    tiles_across: u32,
    tiles_down: u32,
    gaussians: u32,
    // Spherical-harmonics coefficients per channel: 1, 4, 9 or 16.
    coefficients: u32,
    // How many intersections of tiles' lists there is room for.
    intersection_capacity: u32,
    // Where the photograph begins in `photographs`, in pixels.
    photograph: u32,
    // Contributions of each pixel that the replay cache has room for.
    replay_depth: u32,
    // Groups of three channels that are composited: 1 for the colour alone.
    channel_groups: u32,
    // Tile at which a rasterization of some of the tiles begins.
    first_tile: u32,
    // Gaussians are left out of a training step whose hash is below; 0 draws them all.
    dropout_threshold: u32,
    dropout_seed: u32,
    // Least depth of the centre of a Gaussian that is drawn, in scene units.
    near: f32,
}

fn to_camera(view: View, point: vec3f) -> vec3f {
    let p = vec4f(point, 1.0);
    return vec3f(dot(view.to_camera_x, p), dot(view.to_camera_y, p), dot(view.to_camera_z, p));
}

// From camera space to the world, for directions and gradients.
fn to_world(view: View, direction: vec3f) -> vec3f {
    return direction.x * view.to_camera_x.xyz + direction.y * view.to_camera_y.xyz + direction.z * view.to_camera_z.xyz;
}

fn rotate_to_camera(view: View, direction: vec3f) -> vec3f {
    return vec3f(
        dot(view.to_camera_x.xyz, direction),
        dot(view.to_camera_y.xyz, direction),
        dot(view.to_camera_z.xyz, direction),
    );
}
