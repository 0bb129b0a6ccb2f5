"""Where the nodes of a glTF put their meshes."""

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
"""No number of a node's matrix is larger, which also keeps its determinant finite."""


@dataclass(frozen=True)
class Placement:
    """A mesh, which node shows it, for error messages, and the (4, 4) matrix from its coordinates to the scene's."""

    mesh: Any
    where: str
    to_scene: np.ndarray


def placements(document: Document) -> Iterator[Placement]:
    """The meshes of the file's scene, or of all its nodes if it has no scenes.

    Raises:
        PocketGSError: a node hangs on two others, or on itself.
        ValueError: the JSON is not as glTF wants it.
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
    """(4, 4) a node's matrix, which the file states whole and column by column, or in parts."""
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
    """The Gaussians of a mesh where its node puts them.

    Raises:
        PocketGSError: the node stretches, shears or mirrors them: they would no longer be what the file shows.
    """
    matrix = placement.to_scene
    if np.array_equal(matrix, np.eye(4)):
        return gaussians
    linear = matrix[:3, :3]
    factor = float(np.cbrt(np.linalg.det(linear))) if np.all(np.abs(matrix) < LARGEST) else 0.0
    if factor <= 0 or np.abs(linear @ linear.T / factor**2 - np.eye(3)).max() > TOLERANCE:
        raise PocketGSError(f"{placement.where}: stretches, shears or mirrors, expected turns and even scales")
    left, _, right = np.linalg.svd(linear)
    return translated(rotated(scaled(gaussians, factor), left @ right), matrix[:3, 3])
