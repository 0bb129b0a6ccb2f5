// Running sums on any device.
import scan_shared_memory

// The sum over the threads before this one. Every thread of the workgroup must call it.
fn exclusive_scan(value: vec4u, thread: u32) -> vec4u {
    return shared_scan(value, thread);
}
