"""gsplat's dictionary of intermediate results of `rasterization`."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any


class Meta(dict[str, Any]):
    """A dictionary with lazily computed values.

    Training does not use gsplat's tile intersections, and sorting them takes longer than drawing.

    Args:
        known: values that are available, as `dict` takes them: frameworks call `type(meta)(pairs)`.
        computed: functions that compute values, by the names of the values that each returns.
    """

    def __init__(
        self,
        known: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
        computed: Mapping[tuple[str, ...], Callable[[], Iterable[Any]]] = MappingProxyType({}),
    ) -> None:
        super().__init__(known)
        self._waiting = {name: names for names in computed for name in names}
        self._computed = computed
        for name in self._waiting:
            super().__setitem__(name, None)

    def _settle(self, name: str) -> None:
        names = self._waiting.get(name)
        if names is not None:
            for each, value in zip(names, self._computed[names](), strict=True):
                if self._waiting.pop(each, None):
                    super().__setitem__(each, value)

    def __getitem__(self, name: str) -> Any:
        self._settle(name)
        return super().__getitem__(name)

    def __setitem__(self, name: str, value: Any) -> None:
        self._waiting.pop(name, None)
        super().__setitem__(name, value)

    def __delitem__(self, name: str) -> None:
        self._waiting.pop(name, None)
        super().__delitem__(name)

    def __repr__(self) -> str:
        return repr(self.copy())

    def __eq__(self, other: object) -> bool:
        return self.copy() == other

    def __ne__(self, other: object) -> bool:
        return self.copy() != other

    def get(self, name: str, default: Any = None) -> Any:
        """The value of this name, or the default."""
        self._settle(name)
        return super().get(name, default)

    def __iter__(self) -> Iterator[str]:
        """Names; overridden so that `dict(meta)` and `{**meta}` look up each value."""
        return super().__iter__()

    def __reduce__(self) -> Any:
        """Copies and pickles hold all values, without the functions, which cannot be pickled.

        They are ordered dictionaries, which `torch.load` allows by default; it refuses calls of `dict`.
        """
        return OrderedDict, (), None, None, iter(self.items())

    def __ior__(self, other: Any) -> Any:
        self.update(other)
        return self

    def __or__(self, other: Any) -> Any:
        """A plain dictionary of both."""
        return self.copy() | other

    def pop(self, name: str, *default: Any) -> Any:
        """Remove a value and return it."""
        self._settle(name)
        return super().pop(name, *default)

    def popitem(self) -> tuple[str, Any]:
        """Remove the last name, and return it with its value."""
        if self:
            self._settle(next(reversed(self)))
        return super().popitem()

    def clear(self) -> None:
        """Remove all names."""
        self._waiting.clear()
        super().clear()

    def setdefault(self, name: str, default: Any = None) -> Any:
        """The value of this name, which is set to the default if it is missing."""
        self._settle(name)
        return super().setdefault(name, default)

    def update(self, *others: Any, **values: Any) -> None:
        """Set the values of other dictionaries, or of pairs, as those of the names given."""
        for name, value in dict(*others, **values).items():
            self[name] = value

    def items(self) -> Any:
        """All names with their values."""
        return self.copy().items()

    def values(self) -> Any:
        """All values."""
        return self.copy().values()

    def copy(self) -> dict[str, Any]:
        """A plain dictionary with all values."""
        return {name: self[name] for name in self}
