"""The passes that find the voxels of candidates, and those that merge the candidates of each."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pocketgs.gpu.description import Description, Pass, Sequence, shader_names
from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.gpu.sort import Items, digit_counts_bytes, radix_sort, running_sums
from pocketgs.gpu.uniforms import UniformLayout
from pocketgs.gpu.workgroups import BLOCK, THREADS
from pocketgs.prior.cloud.webgpu.layout import ATTRIBUTES, MERGED_WORDS

SHADERS = ShaderLibrary(Path(__file__).parent / "shaders", {"ATTRIBUTES": ATTRIBUTES, "MERGED_WORDS": MERGED_WORDS})
"""The shaders of merging, with the numbers that they share with the host."""

FILL, MERGE = "fill", "merge"
"""Names of the sequences."""

_CANDIDATES = Items("candidate_count", blocks="blocks")


@cache
def describe_merging() -> Description:
    """Describe merging.

    The numbers that the expressions are computed from: candidates, levels and voxels, those that are filled.
    """
    by_candidate = f"ceil_div(candidates, {THREADS})"
    sequences = {
        FILL: Sequence(
            ("first_digit", "second_digit"),
            (
                Pass("voxel keys", "voxel_keys", by_candidate),
                *radix_sort(_CANDIDATES, "keys", "order", "first_digit", 32, lambda _: "1"),
                Pass("second keys", "second_keys", by_candidate),
                *radix_sort(_CANDIDATES, "keys", "order", "second_digit", 32, lambda _: "1"),
                Pass("voxel heads", "voxel_heads", by_candidate),
                *running_sums(_CANDIDATES, "heads", "order", "block_sums", "places"),
            ),
        ),
        MERGE: Sequence((), (Pass("merge", "merge", by_candidate),)),
    }
    buffers = {
        "candidate_count": "4",
        "positions": "12 * candidates",
        "attributes": f"{4 * ATTRIBUTES} * candidates",
        "levels": "4 * candidates",
        "grids": "16 * levels",
        "hashes": "8 * candidates",
        **{name: "4 * candidates" for name in ("keys", "keys_spare", "order", "order_spare", "heads")},
        "first_digit": "8",
        "second_digit": "8",
        "digit_counts": digit_counts_bytes("blocks"),
        "block_sums": "4 * blocks",
        "places": "4 * (candidates + 1)",
        "merged": f"{4 * MERGED_WORDS} * voxels",
    }
    variants = {"scan.exclusive": "scan.shared"}
    shaders = {name: SHADERS.link(name, variants) for name in shader_names(sequences.values())}
    uniforms = {"merging": UniformLayout.of("Merging", shaders["merge"].source)}
    return Description({"blocks": f"ceil_div(candidates, {BLOCK})"}, buffers, uniforms, shaders, sequences)
