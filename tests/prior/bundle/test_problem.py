"""Input checks of bundle adjustment, and their messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.prior.bundle.adjustment import BundleSettings, adjust_bundle, adjust_pose
from pocketgs.prior.features.observations import Observations
from prior.bundle_problem import make_problem, turned_and_moved

FREE = BundleSettings()
HELD = BundleSettings(position_sigma=0.02, rotation_sigma=0.02)

Damage = Callable[[dict[str, Any]], None]


def spoil(**changes: Any) -> Damage:
    return lambda arguments: arguments.update(changes)


def spoil_observations(**changes: Callable[[np.ndarray], np.ndarray]) -> Damage:
    def damage(arguments: dict[str, Any]) -> None:
        seen = arguments["observations"]
        arguments["observations"] = replace(
            seen, **{name: change(getattr(seen, name)) for name, change in changes.items()}
        )

    return damage


def forget(keep: Callable[[Observations], np.ndarray]) -> Damage:
    return lambda arguments: arguments.update(
        observations=arguments["observations"].select(keep(arguments["observations"]))
    )


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (spoil(points=np.full((60, 3), np.nan)), r"points of shape \(60, 3\), expected \(N, 3\) finite"),
        (spoil(points=np.zeros((60, 2))), r"points of shape \(60, 2\)"),
        (spoil(points=np.zeros((50, 3))), "point from 0 to 59, expected 0 to 49"),
        (spoil_observations(frame=lambda frame: frame - 1), "frame from -1 to 4, expected 0 to 5"),
        (spoil_observations(pixels=lambda pixels: pixels * np.inf), "240 observed pixels are not finite"),
        (spoil_observations(pixels=lambda pixels: pixels[:-1]), "expected"),
        (forget(lambda seen: seen.point != 7), "1 points seen by fewer than 2 cameras: 7$"),
        (forget(lambda seen: seen.point < 20), r"40 points seen by fewer than 2 cameras: 20, .*29 and 30 more$"),
        (forget(lambda seen: seen.frame < 0), "no observations"),
        (spoil_observations(frame=lambda frame: frame * 0), "60 points seen by fewer than 2"),
    ],
)
def test_bad_input_is_named(damage: Damage, message: str) -> None:
    problem = make_problem()
    arguments = {"cameras": problem.cameras, "points": problem.points, "observations": problem.observations}
    damage(arguments)
    with pytest.raises(PocketGSError, match=message):
        adjust_bundle(**arguments, settings=FREE)


def test_what_nothing_determines_is_refused() -> None:
    problem = make_problem()
    lonely = [*problem.cameras, problem.cameras[0]]
    with pytest.raises(PocketGSError, match="camera 6 sees 0 points, expected 3 or a prior"):
        adjust_bundle(lonely, problem.points, problem.observations, BundleSettings(position_sigma=1.0))
    one_place = [turned_and_moved(camera, np.zeros(3), -camera.centre) for camera in problem.cameras]
    with pytest.raises(PocketGSError, match="one place"):
        adjust_bundle(one_place, problem.points + 9.0, problem.observations, FREE)


def test_a_pose_that_nothing_determines_is_refused() -> None:
    problem = make_problem()
    camera, points = problem.cameras[0], problem.points[:2]
    pixels = camera.project(points)[0]
    with pytest.raises(PocketGSError, match="camera 0 sees 2 points"):
        adjust_pose(camera, points, pixels, FREE)
    assert adjust_pose(camera, points, pixels, HELD).rmse_after < 1e-9
    with pytest.raises(PocketGSError, match="2 points and 1 pixels"):
        adjust_pose(camera, points, pixels[:1], HELD)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("name", ["huber", "iterations", "position_sigma", "rotation_sigma", "tolerance"])
def test_settings_must_be_positive(name: str, bad: float) -> None:
    with pytest.raises(PocketGSError, match=f"{name} = "):
        BundleSettings(**{name: bad})  # type: ignore[arg-type]
