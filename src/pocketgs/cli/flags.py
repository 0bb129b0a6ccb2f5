"""Converting options to command-line flags."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any


def flags_of(options: Any) -> tuple[str, ...]:
    """The flags that set an option group to these values; defaults are omitted.

    Args:
        options: a dataclass whose fields all have defaults and are booleans, tuples or single values.
    """
    flags: list[str] = []
    for field in fields(options):
        value, name = getattr(options, field.name), field.name.replace("_", "-")
        assert field.default is not MISSING
        if value == field.default:
            continue
        if isinstance(value, bool):
            flags.append(f"--{name}" if value else f"--no-{name}")
        else:
            flags += [f"--{name}", *map(str, value if isinstance(value, tuple) else (value,))]
    return tuple(flags)
