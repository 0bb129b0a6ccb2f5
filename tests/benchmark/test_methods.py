"""Methods are flags of `pocketgs train` that mean what their descriptions say."""

from __future__ import annotations

import pytest
import tyro

from pocketgs.benchmark.methods import METHODS, methods_named
from pocketgs.cli.commands.bench import Everywhere
from pocketgs.errors import PocketGSError
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.effort import sized


def options_of(name: str) -> TrainingOptions:
    return tyro.cli(TrainingOptions, args=list(METHODS[name].flags))


def test_the_default_is_the_default() -> None:
    assert options_of("pocketgs") == TrainingOptions()


@pytest.mark.parametrize(("name", "prior"), [("3dgs-sfm", "colmap"), ("3dgs-mvs", "dense")])
def test_workstation_methods_train_as_3dgs_does(name: str, prior: str) -> None:
    options = sized(options_of(name), [(640, 480)])
    assert (options.recipe, options.seeds, options.prior) == ("reference", "balls", prior)


@pytest.mark.parametrize(
    ("name", "option", "value"),
    [
        ("no-seeding", "seeds", "balls"),
        ("no-bundle", "bundle", False),
        ("no-dense", "prior", "sparse"),
        ("no-exposure", "exposure", "off"),
        ("one-source", "source_views", 1),
        ("15-keyframes", "max_keyframes", 15),
        ("pocketgs-100k", "max_gaussians", 100_000),
    ],
)
def test_an_ablation_differs_in_one_thing(name: str, option: str, value: object) -> None:
    assert vars(options_of(name)) == {**vars(TrainingOptions()), option: value}


def test_every_method_has_the_same_effort_iterations_and_threads() -> None:
    for name in METHODS:
        options = tyro.cli(TrainingOptions, args=[*METHODS[name].flags, *Everywhere().flags])
        assert (options.effort, options.iterations, options.threads) == ("quick", 500, None)


def test_all_cells_share_their_flags() -> None:
    everywhere = Everywhere(effort="standard", iterations=7, evaluate_every=3, engine="cpu")
    options = tyro.cli(TrainingOptions, args=list(everywhere.flags))
    assert (options.effort, options.iterations, options.evaluate_every, options.engine) == ("standard", 7, 3, "cpu")


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(PocketGSError, match="method 'magic': not known, expected one of pocketgs, 3dgs-sfm"):
        methods_named(("pocketgs", "magic"))


def test_a_method_named_twice_is_refused() -> None:
    with pytest.raises(PocketGSError, match="method 'no-dense': named twice"):
        methods_named(("no-dense", "pocketgs", "no-dense"))
