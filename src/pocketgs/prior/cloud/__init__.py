"""The dense cloud: fused from depth maps, and completed where training views see no points."""
