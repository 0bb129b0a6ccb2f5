// Clusters: runs of THREADS Gaussians in the order of memory, skipped whole where the view does not see their bounds.
//
// Of each, `cluster_places` holds its place among the clusters in view, or OUTSIDE.
const OUTSIDE: u32 = 0xffffffffu;

// Words of `cluster_bounds`: least and largest coordinates of the means, the largest log scale, and 1 while these hold.
const BOUND_HIGH: u32 = 3u;
const BOUND_LOG_SCALE: u32 = 6u;
const BOUND_HOLDS: u32 = 7u;
