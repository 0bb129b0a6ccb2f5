"""A GPU that may be lost, and what is told of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Call = Callable[..., Any]

TOLD = """
    let lose;
    const loss = new module.GpuLoss({ lost: new Promise((resolve) => (lose = resolve)) });
    const told = [];
    loss.throwIfLost();
    const tell = async (work) => {
        told.push(await loss.unless(work, () => "Go on.").catch(({ message }) => message));
    };
    await tell(Promise.resolve("done"));
    await tell(Promise.reject(new Error("failed")));
    const endless = tell(new Promise(() => {}));
    const first = tell(Promise.reject(new Error("because of the loss")));
    lose({ message: "pulled out." });
    await Promise.all([endless, first]);
    await tell(new Promise(() => {}));
    await tell(Promise.resolve().then(() => loss.throwIfLost()));
    return told;
"""


def test_loss_is_told_before_what_it_makes_fail(call: Call) -> None:
    lost = "The GPU was lost: pulled out. Go on."
    assert call("gpu_loss.js", TOLD) == ["done", "failed", lost, lost, lost, lost]
