// How many items a list has: every Gaussian, or as many entries as `plan` counted.
override over_gaussians: bool = false;

fn list_length(view: View, entries: u32) -> u32 {
    return select(entries, view.gaussians, over_gaussians);
}
