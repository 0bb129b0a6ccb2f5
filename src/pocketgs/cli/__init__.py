"""The `pocketgs` command: a file a subcommand, each a thin call of the public API."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import tyro

from pocketgs.cli.bench import bench
from pocketgs.cli.convert import convert
from pocketgs.cli.demo import demo
from pocketgs.cli.evaluate import evaluate
from pocketgs.cli.export_colmap import export_colmap
from pocketgs.cli.info import info
from pocketgs.cli.pose import pose
from pocketgs.cli.render import render
from pocketgs.cli.terminal import Terminal
from pocketgs.cli.train import train
from pocketgs.cli.view import view
from pocketgs.errors import PocketGSError

USER_ERROR, INTERRUPTED = 2, 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: 0 on success, 2 for anything the user can put right, 130 for Ctrl-C."""
    subcommands: dict[str, Callable[..., None]] = {
        "train": train,
        "pose": pose,
        "eval": evaluate,
        "render": render,
        "view": view,
        "info": info,
        "convert": convert,
        "export-colmap": export_colmap,
        "demo": demo,
        "bench": bench,
    }
    errors = Terminal(to_errors=True)
    try:
        tyro.extras.subcommand_cli_from_dict(
            subcommands,
            prog="pocketgs",
            description="Turn a phone capture into a 3D Gaussian splat on whatever device is at hand.",
            args=arguments,
            config=(tyro.conf.OmitArgPrefixes,),
        )
    except (PocketGSError, OSError) as error:  # OSError: a full disk, a path that is too long
        errors.say("pocketgs: " + " ".join(str(error).split()), style="red")
        sys.exit(USER_ERROR)
    except MemoryError:
        errors.say("pocketgs: out of memory: try --downscale 2 or fewer --max-gaussians", style="red")
        sys.exit(USER_ERROR)
    except KeyboardInterrupt:
        errors.say("pocketgs: stopped", style="red")
        sys.exit(INTERRUPTED)
