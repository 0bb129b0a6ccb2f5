// Replaying a tile front to back: a ring of threads, each holding one splat, through which the tile's pixels pass.
//
// What a replay carries from one splat to the next are a few numbers per pixel. So thread t takes its splat to pixel p
// at step t + p, just after thread t - 1 has taken its own there; after 64 pixels it takes up the splat 64 places on. A
// splat's sums over the pixels stay in its thread's registers, and no thread adds to another's.
//
// Who imports this says what the sums are, `Sums`, and defines `visit`, which takes a splat to a pixel, and `leave`,
// which is called when the splat has been to all of them.
import view, splats.read, tiles

// A splat in a thread's hand: its Gaussian, its slot, and its place among the sorted intersections.
struct Held {
    splat: Splat,
    gaussian: u32,
    slot: u32,
    intersection: u32,
}

// Take the splats of a range of intersections to the pixels of a tile. Every thread of the workgroup must call it.
fn replay_tile(tile: u32, range: vec2u, thread: u32) {
    if (range.x == range.y) {
        return;
    }
    let origin = vec2f(tile_origin(view, tile)) + 0.5;
    let rounds = (range.y - range.x + TILE_PIXELS - 1u) / TILE_PIXELS;
    // The splat in hand, and the next one, which all threads fetch together.
    var held: Held;
    var next: Held;
    held.intersection = range.y;
    var sums: Sums;
    for (var step = 0u; step < (rounds + 1u) * TILE_PIXELS - 1u; step++) {
        if (step % TILE_PIXELS == 0u) {
            next.intersection = range.x + step + thread;
            if (next.intersection < range.y) {
                next.slot = sorted_slots[next.intersection];
                next.gaussian = slot_splats[next.slot];
                next.splat = read_splat(next.gaussian);
            }
        }
        let pixel = (step - thread) % TILE_PIXELS;
        if (step >= thread && pixel == 0u) {
            held = next;
            sums = Sums();
        }
        if (step >= thread && held.intersection < range.y) {
            visit(held, pixel, origin + vec2f(f32(pixel % TILE), f32(pixel / TILE)), &sums);
            if (pixel == TILE_PIXELS - 1u) {
                leave(held, sums);
            }
        }
        workgroupBarrier();
    }
}
