"""Layouts of uniform buffers."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.gpu.uniforms import UniformLayout


def test_fields_of_a_uniform_are_aligned() -> None:
    """Scalars to 4, pairs to 8, fours to 16 bytes, and the whole to its widest field (WGSL, section 14.4.1)."""
    source = """
struct Other {
    a: vec4f,
}
struct Mixed {
    a: f32,
    // A pair begins at a multiple of 8.
    b: vec2f,
    c: u32,
    d: vec4f,
    e: f32,
}
"""
    layout = UniformLayout.of("Mixed", source)
    places = {"a": ("f32", 0), "b": ("vec2f", 8), "c": ("u32", 16), "d": ("vec4f", 32), "e": ("f32", 48)}
    assert dict(layout.fields) == places
    assert layout.size == 64
    assert UniformLayout.of("Other", source).size == 16
    packed = bytes(layout.pack({"a": 1.5, "b": (2.0, 3.0), "c": 2**32 - 1, "d": (4, 5, 6, 7), "e": -1.0}))
    words = np.frombuffer(packed, np.float32)
    np.testing.assert_array_equal(words[[0, 2, 3, 8, 9, 10, 11, 12]], [1.5, 2, 3, 4, 5, 6, 7, -1])
    assert np.frombuffer(packed, np.uint32)[4] == 2**32 - 1
    with pytest.raises(AssertionError, match="'e'"):
        layout.pack({"a": 1.5, "b": (2.0, 3.0), "c": 1, "d": (4, 5, 6, 7)})
