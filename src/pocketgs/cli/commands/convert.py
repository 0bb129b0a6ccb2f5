"""`pocketgs convert`."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
import tyro

from pocketgs.cli.output_file import SCENE_FILE, check_place
from pocketgs.cli.scene_file import load_any, without_broken, without_broken_weights
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import DEFAULT_MB, memory_bound
from pocketgs.scene.edits import cropped, rotated, scaled, translated, with_sh_degree, without_faint
from pocketgs.scene.formats import SceneFormat, format_of, spz, write_pgs
from pocketgs.scene.formats.pgs_coding import CODINGS
from pocketgs.scene.formats.spz_precision import PRECISIONS, Detail
from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free.edits import edited
from pocketgs.sort_free.file import check_name, write_sort_free
from pocketgs.sort_free.scene import SortFreeScene

Triple: TypeAlias = tuple[float, float, float]
Box: TypeAlias = tuple[float, float, float, float, float, float]


def convert(
    scene: Annotated[Path, tyro.conf.Positional],
    output: Annotated[Path, tyro.conf.Positional],
    crop_box: Box | None = None,
    min_opacity: float = 0.0,
    sh_degree: Literal[0, 1, 2, 3] | None = None,
    scale: float = 1.0,
    rotate: Triple | None = None,
    translate: Triple | None = None,
    detail: Detail | None = None,
    spz_version: spz.Version = spz.CURRENT,
    max_memory: int = DEFAULT_MB,
) -> None:
    """Convert a scene to another format, optionally cropped, thinned out or moved.

    The options apply in the order listed here, whatever their order on the command line. Gaussians that hold NaN or
    infinity are left out. A scene that is drawn without sorting becomes a .ply or a .pgs.

    Args:
        scene: A .pgs, .ply, .compressed.ply, .spz, .sog, .splat, .glb or .gltf, or a result folder.
        output: The file to write; its suffix selects the format.
        crop_box: Keep the Gaussians whose centres lie between xmin ymin zmin and xmax ymax zmax.
        min_opacity: Drop Gaussians of lower opacity.
        sh_degree: Maximum degree of the spherical harmonics; higher ones are dropped.
        scale: Scale by this factor about the origin.
        rotate: Rotate about the axes x, y and z, in this order, by these degrees.
        translate: Move along x, y and z, in scene units.
        detail: Of a .spz or .pgs. A "fine" .spz is close to lossless, a "small" one, the default, 0.6 as large and 0.1
            to 0.2 dB worse where measured. A "fine" .pgs, the default, is 0.1 to 0.2 dB worse than the scene, a "small"
            one 0.6 as large and 0.5 to 0.6 dB worse.
        spz_version: Of a .spz; older viewers read 3 only.
        max_memory: Megabytes that reading may take; larger files are refused.
    """
    chosen = _chosen_format(output, detail, spz_version)
    check_place(output, SCENE_FILE, [scene])
    with memory_bound(max_memory):
        original = load_any(scene)

    def edit(gaussians: Gaussians) -> Gaussians:
        if crop_box is not None:
            gaussians = cropped(gaussians, np.array(crop_box[:3]), np.array(crop_box[3:]))
        if min_opacity:
            gaussians = without_faint(gaussians, min_opacity)
        if len(gaussians) == 0:
            raise PocketGSError(f"{output}: none of {len(original):,} Gaussians is left, nothing was written")
        return _moved(gaussians, scale, rotate, translate)

    if isinstance(original, SortFreeScene):
        check_name(output)
        free = edited(without_broken_weights(scene, original), edit, scale)
        free = replace(free, gaussians=_of_degree(free.gaussians, sh_degree))
        write_sort_free(output, free, detail or "fine")
        count = len(free)
    else:
        gaussians = _of_degree(edit(without_broken(scene, original)), sh_degree)
        chosen.write(output, gaussians)
        count = len(gaussians)
    lines = [f"{count:,} Gaussians in {output}, {output.stat().st_size:,} bytes"]
    lines += [f"{chosen.name} does not keep {chosen.drops}"] if chosen.drops else []
    lines += [f"{chosen.name} rounds {chosen.rounds}"] if chosen.rounds else []
    Terminal().say(*lines)


def _of_degree(gaussians: Gaussians, degree: int | None) -> Gaussians:
    return gaussians if degree is None else with_sh_degree(gaussians, min(degree, gaussians.sh_degree))


def _chosen_format(output: Path, detail: Detail | None, spz_version: spz.Version) -> SceneFormat:
    chosen = format_of(output)
    if spz_version != spz.CURRENT and chosen.write is not spz.write_gaussians:
        raise PocketGSError(f"{output}: --spz-version {spz_version}: expected an output that ends in .spz")
    if chosen.write is write_pgs:
        coding = CODINGS[detail or "fine"]
        return replace(chosen, rounds=coding.rounds, write=partial(write_pgs, coding=coding))
    if chosen.write is not spz.write_gaussians:
        if detail is not None:
            raise PocketGSError(f"{output}: --detail {detail}: expected an output that ends in .spz or .pgs")
        return chosen
    precision = PRECISIONS[detail or "small"]
    write = partial(spz.write_gaussians, version=spz_version, precision=precision)
    return replace(chosen, drops=precision.drops, rounds=precision.rounds, write=write)


def _moved(gaussians: Gaussians, scale: float, rotate: Triple | None, translate: Triple | None) -> Gaussians:
    if scale != 1.0:
        gaussians = scaled(gaussians, scale)
    if rotate is not None:
        if not np.all(np.isfinite(rotate)):
            raise PocketGSError(f"rotate: found {rotate}, expected degrees")
        # Imported here because SciPy is slow to load.
        from scipy.spatial.transform import Rotation

        gaussians = rotated(gaussians, Rotation.from_euler("xyz", rotate, degrees=True).as_matrix())
    if translate is not None:
        gaussians = translated(gaussians, np.array(translate))
    return gaussians
