"""The SSIM of trainers, against the reference."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pocketgs.errors import PocketGSError
from pocketgs.splat.reference.loss import ssim
from pocketgs.torch import fused_ssim


@pytest.mark.parametrize(("padding", "border"), [("valid", 0), ("same", 5)])
def test_similarity_and_gradient_are_those_of_the_reference(padding: str, border: int) -> None:
    generator = torch.Generator().manual_seed(0)
    images = torch.rand(2, 3, 19, 23, generator=generator, requires_grad=True)
    photographs = (images.detach() + 0.2 * torch.rand(2, 3, 19, 23, generator=generator)).clamp(0, 1)
    found = fused_ssim(images, photographs, padding=padding)
    (3.0 * found).backward()
    assert images.grad is not None
    values = []
    for image, photograph, gradient in zip(images.detach(), photographs, images.grad, strict=True):
        wide = [
            np.pad(each.permute(1, 2, 0).double().numpy(), ((border, border), (border, border), (0, 0)))
            for each in (image, photograph)
        ]
        value, d_image = ssim(*wide)
        values.append(value)
        inside = d_image[border : border + 19, border : border + 23]
        np.testing.assert_allclose(gradient.permute(1, 2, 0), 1.5 * inside, atol=1e-6)
    assert found.item() == pytest.approx(np.mean(values), abs=1e-5)


def test_equal_images_have_a_similarity_of_one() -> None:
    image = torch.rand(1, 3, 12, 12)
    assert fused_ssim(image, image).item() == pytest.approx(1.0, abs=1e-5)


def test_what_it_does_not_take() -> None:
    image = torch.rand(1, 3, 12, 12)
    with pytest.raises(PocketGSError, match="same or valid"):
        fused_ssim(image, image, padding="reflect")
    with pytest.raises(PocketGSError, match="11 pixels"):
        fused_ssim(image[..., :9], image[..., :9], padding="valid")
    with pytest.raises(PocketGSError, match="img2: found shape"):
        fused_ssim(image, image[..., :11])
    with pytest.raises(PocketGSError, match="expected float32"):
        fused_ssim(image.double(), image.double())
