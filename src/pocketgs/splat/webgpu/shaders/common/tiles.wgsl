// A tile is a square of TILE x TILE pixels; tiles are numbered along the rows.
const TILE_PIXELS: u32 = TILE * TILE;

// Top left pixel of a tile.
fn tile_origin(view: View, tile: u32) -> vec2u {
    return TILE * vec2u(tile % view.tiles_across, tile / view.tiles_across);
}

// The ellipse α = 1/255 of a splat, ready to be cut by rows of tiles: at a given dy it spans
// dx = slope dy ± √(offset - curvature dy²). It is taken to be `margin` pixels larger on every side.
struct Ellipse {
    mean: vec2f,
    margin: f32,
    half_height: f32,
    // Of the ellipse's rightmost point.
    dy_of_right: f32,
    slope: f32,
    offset: f32,
    curvature: f32,
}

fn ellipse_of(splat: Splat) -> Ellipse {
    return ellipse_within(splat, max(0.0, splat.log2_opacity - LOG2_ALPHA_MIN), 0.0);
}

// A splat's tiles are counted in one shader and listed in another, which a compiler may round in another way. So that
// a list never has more tiles than were counted, the ellipse that is counted is a little larger: by a thousandth of
// its reach, for what cancels near its ends, and by a hundredth of a pixel, for the sum with its centre.
fn counted_ellipse_of(splat: Splat) -> Ellipse {
    return ellipse_within(splat, 1.001 * max(0.0, splat.log2_opacity - LOG2_ALPHA_MIN), 0.01);
}

// The ellipse at which the exponent has fallen by `reach`.
fn ellipse_within(splat: Splat, reach: f32, margin: f32) -> Ellipse {
    let a = splat.exponents.x;
    let b = splat.exponents.y;
    let c = splat.exponents.z;
    let determinant = max(4.0 * a * c - b * b, 1e-37);
    let half_width = sqrt(-4.0 * c * reach / determinant);
    return Ellipse(
        splat.mean,
        margin,
        sqrt(-4.0 * a * reach / determinant),
        -b / (2.0 * c) * half_width,
        -b / (2.0 * a),
        -reach / a,
        determinant / (4.0 * a * a),
    );
}

// First and one past the last of the tiles, along one axis of `size` pixels, that hold a pixel centre from `low` to
// `high`; the same twice where there is none.
fn tiles_between(low: f32, high: f32, size: u32) -> vec2u {
    let first = max(ceil(low - 0.5), 0.0);
    let last = min(floor(high - 0.5), f32(size) - 1.0);
    if (!(first <= last)) {
        return vec2u(0u, 0u);
    }
    return vec2u(u32(first) / TILE, u32(last) / TILE + 1u);
}

fn tile_rows(view: View, ellipse: Ellipse) -> vec2u {
    let reach = ellipse.half_height + ellipse.margin;
    return tiles_between(ellipse.mean.y - reach, ellipse.mean.y + reach, view.height);
}

// The tiles of one row that the ellipse reaches. Its extremes lie at its own left and right if the row holds them, else
// at the row's nearer edge.
fn tile_columns(view: View, ellipse: Ellipse, row: u32) -> vec2u {
    let top = f32(row * TILE) + 0.5 - ellipse.mean.y;
    let bottom = f32(min((row + 1u) * TILE, view.height)) - 0.5 - ellipse.mean.y;
    let right = span_end(ellipse, clamp(ellipse.dy_of_right, top, bottom), 1.0);
    let left = span_end(ellipse, clamp(-ellipse.dy_of_right, top, bottom), -1.0);
    let middle = ellipse.mean.x;
    return tiles_between(middle + left - ellipse.margin, middle + right + ellipse.margin, view.width);
}

fn span_end(ellipse: Ellipse, dy: f32, side: f32) -> f32 {
    return ellipse.slope * dy + side * sqrt(max(0.0, ellipse.offset - ellipse.curvature * dy * dy));
}

fn count_tiles(view: View, splat: Splat) -> u32 {
    let ellipse = counted_ellipse_of(splat);
    let rows = tile_rows(view, ellipse);
    var count = 0u;
    for (var row = rows.x; row < rows.y; row++) {
        let columns = tile_columns(view, ellipse, row);
        count += columns.y - columns.x;
    }
    return count;
}
