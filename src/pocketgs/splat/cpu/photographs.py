"""The training photographs, and the loss of a rendered image against one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.splat.checks import check_masks
from pocketgs.splat.colours import UPDATES, check_transforms, no_transforms, transforms_of
from pocketgs.splat.cpu.colours import transform, transform_backward
from pocketgs.splat.cpu.errors import write_error
from pocketgs.splat.cpu.layout import COLOURS, View
from pocketgs.splat.cpu.lenses.lens import KernelLens, kernel_lens
from pocketgs.splat.cpu.loss import photometric
from pocketgs.splat.cpu.tile_image import TileImage
from pocketgs.splat.reference.colours import learn_transform
from pocketgs.splat.settings import LossSettings, StepSettings


class Canvas:
    """Buffers of a step per pixel and per tile. They are kept: fresh memory costs a page fault every 4 KB."""

    def __init__(self, view: View) -> None:
        self.shape = (view.height, view.width)
        self.drawn = TileImage.empty(view, COLOURS)
        self.image, self.transmittance = self.drawn.image, self.drawn.transmittance
        self.d_image = np.empty_like(self.image)
        self.row_losses = np.empty((COLOURS, view.height), np.float32)
        self.transformed = np.empty((0, *self.shape), np.float32)
        """The image after the photograph's colour transform, if transforms are learned."""


@dataclass(frozen=True)
class TrainingView:
    """One photograph, as planes of uint8; `mask` is (0, 0) if there is none."""

    view: View
    lens: KernelLens
    photo: np.ndarray
    mask: np.ndarray

    @staticmethod
    def of(frame: Frame) -> TrainingView:
        """The view of a frame of a capture."""
        photo = np.ascontiguousarray(np.moveaxis(frame.image, 2, 0))
        return TrainingView(View.of(frame.camera), kernel_lens(frame.camera), photo, _plane_of(frame.mask))


class Photographs:
    """The training views, with their colour transforms.

    Args:
        frames: of the capture.
        threads: number of threads.
    """

    def __init__(self, frames: Sequence[Frame], threads: int) -> None:
        self.views = [TrainingView.of(frame) for frame in frames]
        self._threads = threads
        self._colours = no_transforms(len(frames))

    def set_masks(self, masks: Sequence[np.ndarray | None]) -> None:
        """Replace the masks.

        Raises:
            PocketGSError: they do not fit the photographs.
        """
        check_masks(masks, [(each.view.width, each.view.height) for each in self.views])
        self.views = [replace(each, mask=_plane_of(mask)) for each, mask in zip(self.views, masks, strict=True)]

    def restart_colours(self, table: np.ndarray | None) -> None:
        """Copy the table of colour transforms, or reset them to the identity.

        Raises:
            PocketGSError: the table does not fit the photographs.
        """
        if table is not None:
            check_transforms(table, len(self.views))
        self._colours = no_transforms(len(self.views)) if table is None else table.copy()

    @property
    def colours(self) -> np.ndarray | None:
        """A copy of the table of colour transforms; None if none has been learned."""
        return self._colours.copy() if self._colours[:, UPDATES].any() else None

    @property
    def nbytes(self) -> int:
        """Bytes of the photographs, their masks and their colour transforms."""
        return sum(view.photo.nbytes + view.mask.nbytes for view in self.views) + self._colours.nbytes

    def compare(self, index: int, canvas: Canvas, settings: StepSettings) -> float:
        """Compute the loss, write its gradient to the canvas, and update the photograph's colour transform."""
        if settings.colours is None:
            return self._photometric(index, canvas.image, canvas, settings.loss)
        matrix = transforms_of(self._colours[index : index + 1])[0].astype(np.float32)
        if len(canvas.transformed) == 0:
            canvas.transformed = np.empty_like(canvas.image)
        transform(canvas.image, matrix, self._threads, canvas.transformed)
        loss = self._photometric(index, canvas.transformed, canvas, settings.loss)
        row_sums = np.empty((canvas.shape[0], 3, 4), np.float32)
        transform_backward(canvas.image, matrix, self._threads, canvas.d_image, row_sums)
        learn_transform(self._colours, index, row_sums.sum(axis=0, dtype=np.float64), settings.colours, settings.adam)
        return loss

    def write_error(self, index: int, canvas: Canvas, settings: StepSettings) -> None:
        """Replace the gradient of the last compared image by its error; see `errors.write_error`."""
        view = self.views[index]
        compared = canvas.image if settings.colours is None else canvas.transformed
        write_error(compared, view.photo, view.mask, canvas.d_image)

    def _photometric(self, index: int, image: np.ndarray, canvas: Canvas, settings: LossSettings) -> float:
        view = self.views[index]
        photometric(image, view.photo, view.mask, settings, self._threads, canvas.d_image, canvas.row_losses)
        return float(canvas.row_losses.sum(dtype=np.float64))


def _plane_of(mask: np.ndarray | None) -> np.ndarray:
    return np.zeros((0, 0), np.bool_) if mask is None else np.array(mask, np.bool_, order="C")
