"""Running passes on a device; `executor.js` does the same in a browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial, wraps
from typing import Any, TypeVar, cast

import numpy as np
import wgpu
from numpy.typing import ArrayLike

from pocketgs.errors import PocketGSError
from pocketgs.gpu.adapters import TIMESTAMPS
from pocketgs.gpu.description import Description, Pass, Sequence
from pocketgs.gpu.device import forget_device
from pocketgs.gpu.sizes import Symbols, evaluate
from pocketgs.gpu.timing import CLEAR, Encode, PassTimes, by_timestamps, by_waiting
from pocketgs.gpu.workgroups import MAX_ROW_LENGTH

LARGE_WRITE = 1 << 20

MAX_RECORDED = 64
"""Number of recorded sequences to keep: one per image size and amount of data."""

_LAYOUT_TYPES = {
    "uniform": wgpu.BufferBindingType.uniform,
    "read": wgpu.BufferBindingType.read_only_storage,
    "read_write": wgpu.BufferBindingType.storage,
}
_STORAGE = wgpu.BufferUsage.STORAGE | wgpu.BufferUsage.COPY_DST | wgpu.BufferUsage.COPY_SRC | wgpu.BufferUsage.INDIRECT
_UNIFORM = wgpu.BufferUsage.UNIFORM | wgpu.BufferUsage.COPY_DST


LOST_SIGNS = ("lost", "could not map buffer")
"""Parts of the messages of wgpu's errors that mean that the device was lost: it has no type for that."""

_Method = TypeVar("_Method", bound=Callable[..., Any])


def _with_errors_in_one_line(method: _Method) -> _Method:
    """Turn errors that users can meet, a lost or a full device, into PocketGSError; other errors are our bugs."""

    @wraps(method)
    def wrapped(self: Executor, *given: Any, **named: Any) -> Any:
        try:
            return method(self, *given, **named)
        except wgpu.GPUOutOfMemoryError as error:
            raise PocketGSError(f"the GPU is out of memory: expected a smaller --max-memory ({error})") from error
        except (wgpu.GPUError, RuntimeError) as error:
            if not any(sign in str(error).lower() for sign in LOST_SIGNS):
                raise
            forget_device(self.device)
            expected = "a driver that keeps running (it resets where a step takes too long), or --engine cpu"
            raise PocketGSError(f"the GPU was lost while working: expected {expected}") from error

    return cast("_Method", wrapped)


class _Buffers(dict[str, Any]):
    """Buffers by name. One that is absent was to be enlarged when the GPU had no memory left."""

    def __missing__(self, name: str) -> Any:
        raise PocketGSError(f"{name!r} was lost when the GPU ran out of memory, expected the scene to be loaded anew")


class Executor:
    """Holds a description's pipelines and buffers on a device.

    Args:
        device: from `shared_device`.
        description: what to run.
    """

    def __init__(self, device: Any, description: Description) -> None:
        self.description = description
        self.device = device
        self._buffers = _Buffers(
            (name, device.create_buffer(label=name, size=layout.size, usage=_UNIFORM))
            for name, layout in description.uniforms.items()
        )
        self._layouts: dict[str, Any] = {}
        self._modules: dict[str, Any] = {}
        self._pipelines: dict[tuple[str, tuple[tuple[str, int], ...]], Any] = {}
        self._recordings: dict[tuple[str, tuple[tuple[str, int], ...]], list[_Recorded]] = {}
        self._times: PassTimes | None = None

    def prepare(self) -> None:
        """Compile all pipelines."""
        for sequence in self.description.sequences.values():
            for one in sequence.passes:
                self._pipeline(one)

    @_with_errors_in_one_line
    def reserve(self, sizes: Mapping[str, int]) -> None:
        """Allocate buffers of these sizes in bytes. A buffer whose size changes loses its content."""
        for name, size in sizes.items():
            if name not in self._buffers or self._buffers[name].size != size:
                # What is destroyed is forgotten first: there may be no memory for what takes its place.
                self._recordings.clear()
                if name in self._buffers:
                    self._buffers.pop(name).destroy()
                self._buffers[name] = self.device.create_buffer(label=name, size=size, usage=_STORAGE)

    def grow(self, sizes: Mapping[str, int]) -> None:
        """Let buffers have at least these sizes in bytes. Those that have are kept, others lose their content."""
        present = self.sizes()
        self.reserve({name: size for name, size in sizes.items() if size > present.get(name, 0)})

    def release(self) -> None:
        """Destroy all buffers but the uniform ones."""
        for name in [name for name in self._buffers if name not in self.description.uniforms]:
            self._buffers.pop(name).destroy()
        self._recordings.clear()

    def sizes(self) -> dict[str, int]:
        """Sizes of all allocated buffers in bytes."""
        return {name: buffer.size for name, buffer in self._buffers.items()}

    @_with_errors_in_one_line
    def write(self, name: str, content: np.ndarray, offset: int = 0) -> None:
        """Write to a buffer at a byte offset, in order with submitted sequences."""
        if content.size:
            self.device.queue.write_buffer(self._buffers[name], offset, content.reshape(-1))
            if content.nbytes > LARGE_WRITE:
                self.device.queue.submit([])  # releases the staging copy

    def write_uniform(self, name: str, values: Mapping[str, ArrayLike]) -> None:
        """Set a uniform buffer."""
        self.write(name, self.description.uniforms[name].pack(values))

    @_with_errors_in_one_line
    def copy(self, source: str, target: str, size: int) -> None:
        """Copy the first `size` bytes of a buffer to another, in order with submitted sequences."""
        encoder = self.device.create_command_encoder()
        encoder.copy_buffer_to_buffer(self._buffers[source], 0, self._buffers[target], 0, size)
        self.device.queue.submit([encoder.finish()])

    @_with_errors_in_one_line
    def clear(self, name: str) -> None:
        """Fill a buffer with zeros, in order with submitted sequences."""
        encoder = self.device.create_command_encoder()
        encoder.clear_buffer(self._buffers[name])
        self.device.queue.submit([encoder.finish()])

    @_with_errors_in_one_line
    def read(self, name: str, dtype: type[np.generic], count: int, offset: int = 0) -> np.ndarray:
        """Read `count` numbers, starting at number `offset`. Waits until all submitted work is done."""
        if count == 0:
            return np.empty(0, dtype)
        size = np.dtype(dtype).itemsize
        content = self.device.queue.read_buffer(self._buffers[name], offset * size, count * size)
        return np.frombuffer(content, dtype).copy()

    @_with_errors_in_one_line
    def submit(self, sequence: str, symbols: Symbols) -> None:
        """Run a sequence without waiting for it.

        Args:
            sequence: its name.
            symbols: from `Description.symbols`.
        """
        recorded = self._recorded(sequence, symbols)
        if self._times is None:
            encoder = self.device.create_command_encoder()
            self._clear(encoder, sequence)
            compute = encoder.begin_compute_pass()
            for one in recorded:
                one.dispatch(compute)
            compute.end()
            self.device.queue.submit([encoder.finish()])
        else:
            measure = by_timestamps if self.has_timestamps else by_waiting
            clear: Encode = partial(self._clear, sequence=sequence)
            milliseconds = measure(self.device, clear, [one.dispatch for one in recorded])
            self._times.add([CLEAR, *(one.name for one in recorded)], milliseconds, symbols)

    @_with_errors_in_one_line
    def submit_by_pass(self, sequence: str, symbols: Symbols) -> None:
        """Run a long sequence as `submit` does, but with a submission for each pass.

        Drivers reset GPUs on which one submission takes seconds.
        """
        if self._times is not None:
            self.submit(sequence, symbols)
            return
        for name in self.description.sequences[sequence].cleared:
            self.clear(name)
        for one in self._recorded(sequence, symbols):
            encoder = self.device.create_command_encoder()
            compute = encoder.begin_compute_pass()
            one.dispatch(compute)
            compute.end()
            self.device.queue.submit([encoder.finish()])

    @property
    def has_timestamps(self) -> bool:
        """Whether the device has timestamps; otherwise each pass is timed by submitting it alone and waiting."""
        return TIMESTAMPS in self.device.features

    @contextmanager
    def timed(self) -> Iterator[PassTimes]:
        """Time every pass that is submitted while the block runs, each in its own compute pass."""
        self._times = PassTimes()
        try:
            yield self._times
        finally:
            self._times = None

    def _clear(self, encoder: Any, sequence: str) -> None:
        """Fill a sequence's buffers with zeros."""
        for name in self.description.sequences[sequence].cleared:
            encoder.clear_buffer(self._buffers[name])

    def _recorded(self, sequence: str, symbols: Symbols) -> list[_Recorded]:
        """A sequence's passes with names and sizes resolved, cached per size."""
        key = (sequence, tuple(symbols.items()))
        if key not in self._recordings:
            if len(self._recordings) == MAX_RECORDED:
                self._recordings.clear()
            self._recordings[key] = self._record(self.description.sequences[sequence], symbols)
        return self._recordings[key]

    def _record(self, sequence: Sequence, symbols: Symbols) -> list[_Recorded]:
        recordings = []
        for one in sequence.passes:
            if not evaluate(one.when, symbols):
                continue
            groups = evaluate(one.groups, symbols) if one.groups else None
            if groups == 0:
                continue
            indirect = (self._buffers[one.indirect[0]], one.indirect[1]) if one.indirect else None
            recordings.append(_Recorded(one.name, self._pipeline(one), self._bind_group(one), groups, indirect))
        return recordings

    def _pipeline(self, one: Pass) -> Any:
        key = (one.shader, tuple(sorted(one.constants.items())))
        if key not in self._pipelines:
            shader = self.description.shaders[one.shader]
            if one.shader not in self._modules:
                self._modules[one.shader] = self.device.create_shader_module(label=one.shader, code=shader.source)
            stage = {"module": self._modules[one.shader], "entry_point": "main", "constants": dict(one.constants)}
            layout = self.device.create_pipeline_layout(bind_group_layouts=[self._layout(one.shader)])
            self._pipelines[key] = self.device.create_compute_pipeline(label=one.name, layout=layout, compute=stage)
        return self._pipelines[key]

    def _layout(self, shader: str) -> Any:
        if shader not in self._layouts:
            entries = [
                {
                    "binding": number,
                    "visibility": wgpu.ShaderStage.COMPUTE,
                    "buffer": {"type": _LAYOUT_TYPES[binding.access]},
                }
                for number, binding in enumerate(self.description.shaders[shader].bindings)
            ]
            self._layouts[shader] = self.device.create_bind_group_layout(label=shader, entries=entries)
        return self._layouts[shader]

    def _bind_group(self, one: Pass) -> Any:
        bindings = self.description.shaders[one.shader].bindings
        buffers = [self._buffers[one.buffers.get(binding.name, binding.name)] for binding in bindings]
        entries = [
            {"binding": number, "resource": {"buffer": buffer, "offset": 0, "size": buffer.size}}
            for number, buffer in enumerate(buffers)
        ]
        return self.device.create_bind_group(label=one.name, layout=self._layout(one.shader), entries=entries)


class _Recorded:
    """A pass with all its objects resolved."""

    def __init__(
        self, name: str, pipeline: Any, bind_group: Any, groups: int | None, indirect: tuple[Any, int] | None
    ) -> None:
        self.name = name
        self._pipeline, self._bind_group, self._indirect = pipeline, bind_group, indirect
        self._size = (min(groups, MAX_ROW_LENGTH), -(-groups // MAX_ROW_LENGTH)) if groups else (0, 0)

    def dispatch(self, compute: Any) -> None:
        """Encode the pass into a compute pass."""
        compute.set_pipeline(self._pipeline)
        compute.set_bind_group(0, self._bind_group)
        if self._indirect:
            compute.dispatch_workgroups_indirect(*self._indirect)
        else:
            compute.dispatch_workgroups(*self._size)
