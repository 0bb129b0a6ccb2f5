"""The methods of the benchmark, each a set of flags of `pocketgs train`."""

from __future__ import annotations

from dataclasses import dataclass

from pocketgs.errors import PocketGSError


@dataclass(frozen=True)
class Method:
    """A named configuration.

    Attributes:
        name: as in tables and on the command line.
        what: description in a sentence.
        flags: of `pocketgs train`, beyond those common to all methods.
        stands_for: the method's name in the source's tables, or None if it is not there.
    """

    name: str
    what: str
    flags: tuple[str, ...] = ()
    stands_for: str | None = None


_3DGS = ("--recipe", "reference", "--seeds", "balls")

METHODS = {
    method.name: method
    for method in (
        Method("pocketgs", "Refined poses, dense cloud, discs, fast recipe.", (), "PocketGS"),
        Method(
            "3dgs-sfm",
            "COLMAP's sparse cloud, isotropic seeds, 3DGS's learning rates and loss; poses as in PocketGS.",
            ("--prior", "colmap", *_3DGS),
            "3DGS-SFM-WK",
        ),
        Method(
            "3dgs-mvs",
            "PocketGS's dense cloud, isotropic seeds, 3DGS's learning rates and loss.",
            _3DGS,
            "3DGS-MVS-WK",
        ),
        Method("no-seeding", "PocketGS with balls instead of discs.", ("--seeds", "balls"), "w/o I"),
        Method("no-bundle", "PocketGS with the capture's own poses.", ("--no-bundle",), "w/o Global BA"),
        Method("no-dense", "PocketGS on the points of matched features.", ("--prior", "sparse"), "w/o MVS"),
        Method("no-exposure", "PocketGS without exposure compensation.", ("--exposure", "off")),
        Method("one-source", "PocketGS with depth from one source view per keyframe.", ("--source-views", "1")),
        Method("15-keyframes", "PocketGS with as many keyframes as the source has.", ("--max-keyframes", "15")),
        Method("pocketgs-100k", "PocketGS with twice the Gaussians.", ("--max-gaussians", "100000")),
    )
}


def methods_named(names: tuple[str, ...]) -> list[Method]:
    """The methods with these names; all of them if none is named.

    Raises:
        PocketGSError: one is unknown, or named twice.
    """
    for name in names:
        if name not in METHODS:
            raise PocketGSError(f"method {name!r}: not known, expected one of {', '.join(METHODS)}")
        if names.count(name) > 1:
            raise PocketGSError(f"method {name!r}: named twice, expected each once")
    return [METHODS[name] for name in names or METHODS]
