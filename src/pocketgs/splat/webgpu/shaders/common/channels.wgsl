// What a splat shows. Channels are composited three at a time: a group stands where an image has its colour.

section colour
import splats
// Its colour, the only group.
fn shown(splat: Splat, gaussian: u32, group: u32) -> vec3f {
    return splat.colour;
}

section groups
import splats
// Any number of groups, Gaussian after Gaussian.
@group(0) @binding(7) var<storage, read> channels: array<f32>;

fn shown(splat: Splat, gaussian: u32, group: u32) -> vec3f {
    let first = 3u * (gaussian * view.channel_groups + group);
    return vec3f(channels[first], channels[first + 1u], channels[first + 2u]);
}
