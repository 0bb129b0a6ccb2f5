"""Every pass on a device that has no more than WebGPU guarantees; `test_browser.py` does the same in a browser."""

from __future__ import annotations

import re
from typing import Any

import pytest
import wgpu

from pocketgs.gpu.adapters import Adapter
from pocketgs.gpu.executor import Executor
from splat.webgpu.every_description import PORTABLE, every_shader

CORE_LIMITS = {
    "max-texture-dimension-1d": 8192,
    "max-texture-dimension-2d": 8192,
    "max-texture-dimension-3d": 2048,
    "max-texture-array-layers": 256,
    "max-bind-groups": 4,
    "max-bindings-per-bind-group": 1000,
    "max-dynamic-uniform-buffers-per-pipeline-layout": 8,
    "max-dynamic-storage-buffers-per-pipeline-layout": 4,
    "max-sampled-textures-per-shader-stage": 16,
    "max-samplers-per-shader-stage": 16,
    "max-storage-buffers-per-shader-stage": 8,
    "max-storage-textures-per-shader-stage": 4,
    "max-uniform-buffers-per-shader-stage": 12,
    "max-uniform-buffer-binding-size": 65_536,
    "max-storage-buffer-binding-size": 128 << 20,
    "min-uniform-buffer-offset-alignment": 256,
    "min-storage-buffer-offset-alignment": 256,
    "max-buffer-size": 256 << 20,
    "max-compute-workgroup-storage-size": 16_384,
    "max-compute-invocations-per-workgroup": 256,
    "max-compute-workgroup-size-x": 256,
    "max-compute-workgroup-size-y": 256,
    "max-compute-workgroup-size-z": 64,
    "max-compute-workgroups-per-dimension": 65_535,
}
"""WebGPU, section 3.6.2, as far as compute passes can meet them."""

SHADER = """
@group(0) @binding(0) var<storage, read_write> first: array<u32>;
@group(0) @binding(1) var<storage, read_write> second: array<u32>;
{more}
var<workgroup> kept: array<u32, {words}>;
@compute @workgroup_size({threads})
fn main(@builtin(local_invocation_index) thread: u32) {{
    kept[thread] = first[thread];
    workgroupBarrier();
    second[thread] = kept[0]{read};
}}
"""


@pytest.fixture(scope="module")
def core_device(adapter: Adapter) -> Any:
    return adapter.handle.request_device_sync(required_features=[], required_limits=CORE_LIMITS)


def test_every_shader_compiles_with_the_least_limits_and_no_features(core_device: Any) -> None:
    assert {name: core_device.limits[name] for name in CORE_LIMITS} == CORE_LIMITS
    executor = Executor(core_device, every_shader())
    assert len(executor.description.sequences["all"].passes) > 50
    executor.prepare()


@pytest.mark.parametrize(
    ("buffers", "words", "threads", "fits"), [(8, 4096, 256, True), (9, 16, 1, False), (2, 16, 257, False)]
)
def test_the_device_refuses_what_needs_more(
    core_device: Any, buffers: int, words: int, threads: int, fits: bool
) -> None:
    """Else the test above would say nothing."""
    names = [f"more_{number}" for number in range(2, buffers)]
    bound = enumerate(names, 2)
    more = "\n".join(f"@group(0) @binding({i}) var<storage, read_write> {name}: array<u32>;" for i, name in bound)
    read = "".join(f" + {name}[0]" for name in names)
    code = SHADER.format(more=more, words=words, threads=threads, read=read)

    def compile_it() -> None:
        module = core_device.create_shader_module(code=code)
        core_device.create_compute_pipeline(layout="auto", compute={"module": module, "entry_point": "main"})

    if fits:
        compile_it()
    else:
        with pytest.raises(wgpu.GPUError):
            compile_it()


@pytest.mark.parametrize("name", PORTABLE)
def test_shaders_are_written_for_every_compiler(name: str) -> None:
    """No shader uses WGSL that only wgpu accepts: extensions, atomic floats, buffer pointers passed to functions."""
    for shader in PORTABLE[name].shaders.values():
        source = re.sub(r"//.*", "", shader.source)
        assert not shader.extensions, shader.name
        assert not re.search(r"^\s*(enable|requires|diagnostic)\b", source, re.MULTILINE), shader.name
        assert not re.search(r"\bsubgroup|\bquad|\bf16\b|\bi64\b|\bu64\b|\bf64\b|push_constant", source), shader.name
        assert not re.search(r"atomic<\s*f", source), shader.name
        assert not re.search(r"ptr<\s*(storage|workgroup|uniform)", source), shader.name
        handed_over = set(re.findall(r"(\w+)\((?:[^()]*,\s*)?&\w", source))
        assert {one for one in handed_over if not one.startswith("atomic")} <= {"arrayLength", "workgroupUniformLoad"}
