// One sweep of a view. Written anew for every sweep.
struct Sweep {
    // Of the view.
    width: u32,
    height: u32,
    // What all images are padded to.
    image_width: u32,
    image_height: u32,
    // Source views.
    sources: u32,
    hypotheses: u32,
    // Groups of LANE hypotheses.
    lanes: u32,
    // Bands of rows that the volume lies in, and rows of each; the last may have fewer.
    bands: u32,
    band_rows: u32,
    // Penalties of semi-global matching, and the number of its paths.
    small_step: u32,
    large_step: u32,
    paths: u32,
    // 1 if depths beyond the first hypothesis are possible, so that it counts as none.
    is_bounded: u32,
    // 1 if source views have masks.
    has_masks: u32,
    // Difference of neighbouring hypotheses.
    step: f32,
}

section band
// A volume as large as a binding may not be lies in bands of rows, each in buffers of its own. A pass works on one.
override band: u32 = 0u;

fn band_top() -> u32 {
    return min(band * sweep.band_rows, sweep.height);
}

fn band_bottom() -> u32 {
    return min(band_top() + sweep.band_rows, sweep.height);
}
