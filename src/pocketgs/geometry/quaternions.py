"""Quaternions: conversion to rotations, products, and compression by dropping the largest component."""

from __future__ import annotations

import numpy as np

MAX_OTHER = np.sqrt(0.5)
"""Bound of all components of a unit quaternion except the largest."""

SHORTEST, LONGEST = 1e-15, 1e15
"""Lengths of quaternions whose squares float32 holds."""


def unit(quaternions: np.ndarray) -> np.ndarray:
    """(N, 4) float64 normalised quaternions, however short or long.

    Those of length 0 become the identity (1, 0, 0, 0), those with NaN or infinity NaN.
    """
    largest = np.abs(quaternions).max(axis=1, keepdims=True).astype(np.float64)
    whole = np.where(largest == 0, np.eye(4)[0], quaternions)
    with np.errstate(invalid="ignore"):
        scaled = whole / np.where(largest == 0, 1.0, largest)
        return np.asarray(scaled / np.linalg.norm(scaled, axis=1, keepdims=True))


def of_unit_length(quaternions: np.ndarray) -> np.ndarray:
    """(N, 4) normalised quaternions of the same type, as `unit`.

    Those of length 1 keep their bits: normalising can change the last one, and a resumed run must not differ.
    """
    with np.errstate(all="ignore"):
        lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
        whole = np.where(np.abs(lengths - 1.0) > 1e-6, quaternions / lengths, quaternions)
    extreme = np.isfinite(quaternions).all(axis=1) & ~((lengths > SHORTEST) & (lengths < LONGEST))[:, 0]
    whole[extreme] = unit(quaternions[extreme])
    return whole


def rotation_matrices(quaternions: np.ndarray) -> np.ndarray:
    """(N, 3, 3) rotation matrices of (N, 4) quaternions w, x, y, z, which `unit` normalises."""
    w, x, y, z = unit(quaternions).astype(quaternions.dtype).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def composed(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(..., 4) product of quaternions w, x, y, z: rotates by `second`, then by `first`."""
    w, v = first[..., :1], first[..., 1:]
    other_w, other_v = second[..., :1], second[..., 1:]
    real = w * other_w - np.sum(v * other_v, axis=-1, keepdims=True)
    return np.concatenate([real, w * other_v + other_w * v + np.cross(v, other_v)], axis=-1)


def drop_largest(quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drop each quaternion's largest component after making it positive; the unit length determines it.

    Args:
        quaternions: (N, 4) of length 1, in any order of components.

    Returns:
        (N,) index of the dropped component, and (N, 3) the others in order.
    """
    largest = np.abs(quaternions).argmax(axis=1)
    signs = np.where(np.take_along_axis(quaternions, largest[:, None], axis=1) < 0, -1.0, 1.0)
    return largest, np.take_along_axis(quaternions * signs, _others(largest), axis=1)


def restore_largest(largest: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(N, 4) quaternions from the output of `drop_largest`."""
    quaternions = np.empty((len(others), 4))
    np.put_along_axis(quaternions, _others(largest), others, axis=1)
    left = np.sqrt(np.clip(1.0 - np.sum(others**2, axis=1), 0.0, None))
    np.put_along_axis(quaternions, largest[:, None], left[:, None], axis=1)
    return quaternions


def _others(largest: np.ndarray) -> np.ndarray:
    """(N, 3) the three indices from 0 to 3 other than `largest`, in order."""
    table = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    return table[largest]
