"""What the run of a result folder was trained on, as its files tell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pocketgs.capture.capture import Capture, Frame
from pocketgs.errors import PocketGSError, clipped, counted
from pocketgs.files.json_fields import read_json
from pocketgs.results.cameras_file import SavedCameras, holds_cameras, read_cameras
from pocketgs.results.folder import CAMERAS, RECORD
from pocketgs.scene.background import Background


@dataclass(frozen=True)
class TrainedOn:
    """What a run was trained on.

    Attributes:
        background: behind its photographs.
        views: names of its training views; empty if unknown.
        cameras: of the run.
        held_out: whether it held views out.
        protocol: how its photographs were prepared and split, as text.
        shrink: factor by which it reduced photographs further than its options asked for, to fit in memory.
    """

    background: Background
    views: frozenset[str]
    cameras: SavedCameras
    held_out: bool
    protocol: str
    shrink: int

    def overlap(self, capture: Capture) -> str | None:
        """Tells which held-out views of a capture the run was trained on, and what to do; None if there are none.

        Args:
            capture: in the world of the run.
        """
        seen = [frame.name for frame in capture.held_out if self._saw(frame)]
        if not seen:
            return None
        held_out = counted(len(capture.held_out), "view that is held out", "views that are held out")
        found = f"was trained on {len(seen)} of the {held_out}, the first {clipped(seen[0])}"
        if not self.held_out:
            return f"{found}, since its run held nothing out: train it with --hold-out to measure it"
        return f"{found}: {self._protocols(capture)}"

    def difference(self, capture: Capture) -> str | None:
        """Tells how a capture differs from what the run was trained on, and what to do; None if it is the same.

        Args:
            capture: in the world of the run.
        """
        differences = []
        if moved := self.cameras.moved(capture.frames):
            views = counted(len(moved), "view has another pose", "views have other poses")
            found = f"{views} than in its run, the first {clipped(moved[0])}"
            differences.append(f"{found}: figures mean nothing unless it is another capture in the same world")
        if capture.protocol != self.protocol:
            differences.append(self._protocols(capture))
        if differences:
            return "; ".join(differences)
        if self.cameras.cameras and not any(frame.name in self.cameras.cameras for frame in capture.frames):
            trained, read = next(iter(self.cameras.cameras)), capture.frames[0].name
            names = f"such as {clipped(trained)}, the first is {clipped(read)}"
            hint = "give the capture and the options that it was trained with, such as --images"
            return f"no photograph has a name that its run knows, {names}: {hint}"
        return None

    def _saw(self, frame: Frame) -> bool:
        """Whether the run was trained on a frame, or on a copy of it with another name, from another image folder."""
        names = self.cameras.at_pose_of(frame)
        # From a tripod, a held-out photograph has the pose of training views: here its name decides.
        return frame.name in self.views if frame.name in names else not self.views.isdisjoint(names)

    def _protocols(self, capture: Capture) -> str:
        protocols = f"the protocol of its run is {self.protocol!r}, here it is {capture.protocol!r}"
        if self.shrink > 1:
            return f"{protocols}; to fit in memory, its run reduced photographs by another factor of {self.shrink}"
        options = "--images, --downscale, --max-size or --hold-out"
        return f"{protocols}; give the options that it was trained with, such as {options}"


def trained_on(folder: Path) -> TrainedOn | None:
    """What the run of a result folder was trained on; None if the folder has no record of a run.

    Raises:
        PocketGSError: the folder's cameras cannot be read.
    """
    try:
        record = read_json(folder / RECORD).values
        red, green, blue = map(float, record["capture"]["background"])
        held_out = {str(image["name"]) for image in record["images"]}
        protocol, shrink = str(record["protocol"]), int(record["plan"]["shrink"])
    except (PocketGSError, OSError, KeyError, TypeError, ValueError):
        return None
    known = read_cameras(folder / CAMERAS) if holds_cameras(folder / CAMERAS) else SavedCameras({}, refined=False)
    views = frozenset(known.cameras) - held_out
    return TrainedOn((red, green, blue), views, known, bool(held_out), protocol, shrink)
