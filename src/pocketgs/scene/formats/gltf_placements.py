"""Transforms of a glTF's nodes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.quaternions import unit
from pocketgs.scene.edits import rotated, scaled, translated
from pocketgs.scene.formats.gltf_accessors import item
from pocketgs.scene.formats.gltf_document import Document
from pocketgs.scene.gaussians import Gaussians

TOLERANCE = 1e-4
LARGEST = 1e30
"""Maximum magnitude of a matrix entry, which keeps the determinant finite."""


@dataclass(frozen=True)
class Placement:
    """A mesh, its node for error messages, and the (4, 4) matrix from mesh to scene coordinates."""

    mesh: Any
    where: str
    to_scene: np.ndarray


def placements(document: Document) -> Iterator[Placement]:
    """The meshes of the file's scene, or of all nodes if it has no scene.

    Raises:
        PocketGSError: a node has two parents, or is its own ancestor.
        ValueError: the JSON violates the glTF specification.
    """
    waiting = [(node, np.eye(4)) for node in _roots(document)]
    seen: set[int] = set()
    while waiting:
        index, above = waiting.pop()
        node = item(document, "nodes", index)
        if index in seen:
            raise PocketGSError(f"{document.path}: node {index} is reached twice, expected a tree")
        seen.add(index)
        to_scene = above @ _local(node)
        if "mesh" in node:
            yield Placement(node["mesh"], f"{document.path}, node {index}", to_scene)
        waiting += [(child, to_scene) for child in node.get("children", [])]


def _roots(document: Document) -> list[Any]:
    if document.json.get("scenes"):
        return list(item(document, "scenes", document.json.get("scene", 0)).get("nodes", []))
    nodes = document.json.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    return [index for index in range(len(nodes)) if index not in children]


def _local(node: dict[str, Any]) -> np.ndarray:
    """(4, 4) matrix of a node, stated as a matrix (column by column) or as translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    rotation = unit(np.array([node.get("rotation", [0, 0, 0, 1])], dtype=np.float64))[0]
    scale = np.array(node.get("scale", [1, 1, 1]), dtype=np.float64).reshape(3)
    matrix[:3, :3] = Rotation.from_quat(rotation).as_matrix() * scale
    matrix[:3, 3] = np.array(node.get("translation", [0, 0, 0]), dtype=np.float64).reshape(3)
    return matrix


def placed(gaussians: Gaussians, placement: Placement) -> Gaussians:
    """Transform the Gaussians of a mesh by their node's matrix.

    Raises:
        PocketGSError: the node stretches, shears or mirrors, which Gaussians with their harmonics cannot follow.
    """
    matrix = placement.to_scene
    if np.array_equal(matrix, np.eye(4)):
        return gaussians
    linear = matrix[:3, :3]
    factor = float(np.cbrt(np.linalg.det(linear))) if np.all(np.abs(matrix) < LARGEST) else 0.0
    if factor <= 0 or np.abs(linear @ linear.T / factor**2 - np.eye(3)).max() > TOLERANCE:
        raise PocketGSError(f"{placement.where}: stretches, shears or mirrors, expected a rotation and a uniform scale")
    left, _, right = np.linalg.svd(linear)
    return translated(rotated(scaled(gaussians, factor), left @ right), matrix[:3, 3])
