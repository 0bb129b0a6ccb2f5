"""Names of the devices that compute: of every stage of the prior, of seeding, and of training."""

from __future__ import annotations

from typing import Literal

DeviceName = Literal["cpu", "webgpu"]
