"""The built-in demo capture: a ray-cast phone walk around a laid table, with ground truth."""

from pocketgs.capture.synthetic.folder import read_ground_truth, write_demo
from pocketgs.capture.synthetic.recording import GroundTruth, demo_capture, demo_ground_truth, true_capture

__all__ = ["GroundTruth", "demo_capture", "demo_ground_truth", "read_ground_truth", "true_capture", "write_demo"]
