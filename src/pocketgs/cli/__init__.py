"""The `pocketgs` command; `commands/` has one file per subcommand."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Any

import tyro

from pocketgs.cli.terminal import Terminal
from pocketgs.errors import USER_ERROR, PocketGSError
from pocketgs.scene.warning import SceneWarning
from pocketgs.system.interrupt import STOPPED

SUBCOMMANDS = {
    "train": "train",
    "pose": "pose",
    "eval": "evaluate",
    "render": "render",
    "view": "view",
    "info": "info",
    "compress": "compress",
    "distil": "distil",
    "convert": "convert",
    "export-colmap": "export_colmap",
    "serve": "serve",
    "site": "site",
    "demo": "demo",
    "bench": "bench",
}
"""Module and function of each subcommand. Only the requested one is loaded, since all together take long."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: 0 on success, 2 for errors that the user can fix, 130 for Ctrl-C."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given == ["--version"]:
        Terminal().say(f"pocketgs {version('pocketgs')}")
        return
    errors = Terminal(to_errors=True)
    if not sys.warnoptions:
        _show_scene_warnings_only(errors)
    try:
        if given and given[0] in SUBCOMMANDS:
            name, *rest = given
            tyro.cli(_subcommand(name), prog=f"pocketgs {name}", args=rest, config=(tyro.conf.OmitArgPrefixes,))
        else:
            tyro.extras.subcommand_cli_from_dict(
                {name: _subcommand(name) for name in SUBCOMMANDS},
                prog="pocketgs",
                description="Turn a phone capture into a 3D Gaussian splat on whatever device is at hand. "
                "--version prints the version.",
                args=given,
                config=(tyro.conf.OmitArgPrefixes,),
            )
    except (PocketGSError, OSError) as error:  # OSError: a full disk, a path that is too long
        errors.say("pocketgs: " + " ".join(str(error).split()), style="red")
        sys.exit(USER_ERROR)
    except MemoryError:
        errors.say(
            "pocketgs: out of memory: close other programs, or use smaller photographs or fewer Gaussians", style="red"
        )
        sys.exit(USER_ERROR)
    except KeyboardInterrupt as stop:
        errors.say(": ".join(["pocketgs: stopped", *map(str, stop.args)]), style="red")
        sys.exit(STOPPED)


def _show_scene_warnings_only(errors: Terminal) -> None:
    """Print warnings about scenes as the other messages; the rest names lines of source, for developers."""

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        errors.say(f"warning: {message}", style="yellow")

    warnings.simplefilter("ignore")
    warnings.filterwarnings("default", category=SceneWarning)
    warnings.showwarning = show


def _subcommand(name: str) -> Callable[..., Any]:
    module = SUBCOMMANDS[name]
    function: Callable[..., Any] = getattr(import_module(f"{__name__}.commands.{module}"), module)
    return function
