// A cluster is the run of Gaussians that one workgroup projects. Where the runs are compact in space and their bounds
// are known, clusters outside the view can be skipped here; in the order of training they are not.
fn cluster_in_view(cluster: u32) -> bool {
    return true;
}
