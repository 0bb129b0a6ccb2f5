"""Which frames become keyframes: far enough from the last one, sharper than those around, and not too many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pocketgs.camera import Camera
from pocketgs.capture.capture import Frame
from pocketgs.capture.sharpness import sharpness
from pocketgs.errors import PocketGSError
from pocketgs.prior.scale import Scale
from pocketgs.prior.tracks import view_distances

CANDIDATES_PER_KEYFRAME = 3
"""Windows shrink until so many frames for each keyframe pass them: coverage is then chosen from what is sharp."""


@dataclass(frozen=True)
class GateSettings:
    """When a frame becomes a keyframe.

    Attributes:
        displacement: least distance from the last keyframe, in metres, or where the capture is not metric in units of
            the distance to the scene.
        window: frames among which the sharpest is chosen; fewer in short captures.
        sharper: a frame must be sharper than the window's best by this share to take its place.
        max_keyframes: hard bound.
    """

    displacement: float = 0.05
    window: int = 8
    sharper: float = 0.05
    max_keyframes: int = 15

    def __post_init__(self) -> None:
        if self.max_keyframes < 2:
            raise PocketGSError(f"max keyframes: found {self.max_keyframes}, expected at least 2")


@dataclass(frozen=True)
class Decision:
    """What the gate made of a frame, and why.

    Attributes:
        name: the frame's.
        kept: whether it is a keyframe.
        reason: in words.
        sharpness: mean absolute difference of neighbouring grey levels, see `pocketgs.capture.sharpness`.
        displacement: distance from the keyframe before it, infinite for the first.
    """

    name: str
    kept: bool
    reason: str
    sharpness: float
    displacement: float


def choose_keyframes(frames: Sequence[Frame], scale: Scale, settings: GateSettings) -> list[Decision]:
    """Decide on every frame, in capture order.

    Args:
        frames: in the order they were taken; stills in any.
        scale: of the scene.
        settings: the thresholds.

    Returns:
        One decision a frame. At least one is kept if there is a frame.
    """
    sharpnesses = [sharpness(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)) for frame in frames]
    window = int(np.clip(len(frames) // (CANDIDATES_PER_KEYFRAME * settings.max_keyframes), 1, settings.window))
    decisions: list[Decision] = []
    last: Camera | None = None
    for start in range(0, len(frames), window):
        best: int | None = None
        for index in range(start, min(start + window, len(frames))):
            moved = _distance(frames[index].camera, last)
            near = moved < settings.displacement * scale.unit
            reason = f"{moved:.3g} from the keyframe before" if near else ""
            if not near and best is not None and sharpnesses[index] <= (1 + settings.sharper) * sharpnesses[best]:
                reason = f"not sharper than {frames[best].name}"
            elif not near:
                if best is not None:
                    decisions[best] = replace(decisions[best], kept=False, reason=f"{frames[index].name} is sharper")
                best = index
            decisions.append(Decision(frames[index].name, best == index, reason, sharpnesses[index], moved))
        if best is not None:
            last = frames[best].camera
    return _thinned(decisions, frames, scale.distance, settings.max_keyframes)


def _distance(camera: Camera, last: Camera | None) -> float:
    return float(np.linalg.norm(camera.centre - last.centre)) if last is not None else float("inf")


def _thinned(decisions: list[Decision], frames: Sequence[Frame], distance: float, most: int) -> list[Decision]:
    """Drop keyframes until `most` are left: again and again the one whose views a sharper one stands for best."""
    kept = [index for index, decision in enumerate(decisions) if decision.kept]
    cameras = [frames[index].camera for index in kept]
    sharpnesses = np.array([decisions[index].sharpness for index in kept])
    # How far, from the view of each column, lie those that the view of each row stands for: itself, and what was
    # dropped in its favour. Without these the neighbours of a gap would be the next to go.
    reach = view_distances(cameras, cameras, distance)
    reach[sharpnesses[:, None] > sharpnesses] = np.inf
    np.fill_diagonal(reach, np.inf)
    result = list(decisions)
    for _ in range(len(kept) - most):
        dropped, other = np.unravel_index(np.argmin(reach), reach.shape)
        reason = f"the view is covered by {decisions[kept[other]].name}"
        result[kept[dropped]] = replace(decisions[kept[dropped]], kept=False, reason=reason)
        reach[other] = np.maximum(reach[other], reach[dropped])
        reach[dropped, :] = reach[:, dropped] = np.inf
    return [replace(decision, reason="new view") if decision.kept else decision for decision in result]
