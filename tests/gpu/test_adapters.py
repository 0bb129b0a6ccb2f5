"""The choice of the adapter, and the messages if none is suitable."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.gpu import adapters as adapters_module
from pocketgs.gpu.adapters import NEEDED, Adapter, adapters, choose_adapter, has_gpu
from pocketgs.gpu.device import forget_device, open_device, shared_device
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.choose_engine import chosen_engine, create_engine
from pocketgs.splat.engine import EngineName, EngineOptions
from pocketgs.splat.webgpu.engine import WebGpuEngine
from splat.training_step import camera_in_front


def pretend(monkeypatch: pytest.MonkeyPatch, *found: Adapter) -> None:
    """Let these be the devices of this machine."""
    monkeypatch.setattr(adapters_module, "adapters", lambda: found)
    monkeypatch.setattr(adapters_module, "_DEVICE_FILES", ("null",))


def as_gpu(adapter: Adapter, name: str = "Shiny 3000", **limits: int) -> Adapter:
    """The adapter as a GPU that would be preferred to any."""
    return replace(adapter, name=name, kind="DiscreteGPU", limits={**adapter.limits, **limits})


def as_software(adapter: Adapter) -> Adapter:
    return replace(adapter, name="llvmpipe (LLVM 15.0.6, 256 bits)", kind="CPU")


def test_software_adapters_come_last(adapter: Adapter) -> None:
    software = [one.is_software for one in adapters()]
    assert software == sorted(software)
    assert adapter.name
    assert adapter.backend in ("Vulkan", "Metal", "D3D12")


def test_adapters_are_found_after_another_library_has_opened_gpus(adapter: Adapter) -> None:
    code = (
        "import wgpu; wgpu.gpu.enumerate_adapters_sync(); from pocketgs.gpu.adapters import adapters; "
        "print([one.backend for one in adapters()])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert adapter.backend in run.stdout
    assert "OpenGL" not in run.stdout


def test_where_all_adapters_are_software_auto_takes_the_cpu(adapter: Adapter, monkeypatch: pytest.MonkeyPatch) -> None:
    if not adapter.is_software:
        pretend(monkeypatch, as_software(adapter))
    assert not has_gpu()
    assert create_engine().name == create_engine(EngineOptions("auto")).name == "cpu"
    engine = create_engine(EngineOptions("webgpu"))
    assert isinstance(engine, WebGpuEngine)
    assert choose_adapter().is_software
    assert choose_adapter().name in engine.device


@pytest.mark.parametrize(
    ("name", "kind", "is_software"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", "CPU", True),
        ("SwiftShader Device (Subzero)", "VirtualGPU", True),
        ("Microsoft Basic Render Driver", "IntegratedGPU", True),
        ("Apple M2", "IntegratedGPU", False),
        ("Virtio-GPU Venus", "VirtualGPU", False),
    ],
)
def test_software_is_told_by_kind_and_by_name(adapter: Adapter, name: str, kind: str, is_software: bool) -> None:
    assert replace(adapter, name=name, kind=kind).is_software == is_software


def test_where_there_is_a_gpu_auto_takes_it(adapter: Adapter, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, as_gpu(adapter), adapter)
    assert has_gpu()
    engine = create_engine()
    assert isinstance(engine, WebGpuEngine)
    assert "Shiny 3000" in engine.device


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere GPUs have no files")
def test_without_a_gpu_in_dev_no_driver_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adapters_module, "_DEVICE_FILES", ("no such thing*",))
    monkeypatch.setattr(adapters_module, "adapters", lambda: pytest.fail("looked for devices"))
    assert not has_gpu()
    assert create_engine().name == "cpu"


def test_a_gpu_is_chosen_by_part_of_its_name(adapter: Adapter, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, as_gpu(adapter), as_gpu(adapter, "Frugal 12"), as_software(adapter))
    assert choose_adapter().name == "Shiny 3000"
    assert choose_adapter("frugal").name == "Frugal 12"
    assert choose_adapter("LLVMpipe").is_software


@pytest.mark.parametrize("engine", ["auto", "webgpu"])
def test_an_unknown_name_is_refused_with_what_was_found(adapter: Adapter, engine: EngineName) -> None:
    with pytest.raises(PocketGSError) as refusal:
        create_engine(EngineOptions(engine, gpu="no such thing"))
    message = str(refusal.value)
    assert "'no such thing'" in message
    assert adapter.name in message
    assert "\n" not in message


def test_a_name_chooses_the_engine_too(adapter: Adapter, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, as_software(adapter))
    assert chosen_engine(EngineOptions()) == "cpu"
    assert chosen_engine(EngineOptions(gpu="llvm")) == "webgpu"
    with pytest.raises(PocketGSError, match="gpu 'llvm': not used by engine cpu"):
        chosen_engine(EngineOptions("cpu", gpu="llvm"))


def test_without_any_adapter_the_cpu_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch)
    assert not has_gpu()
    assert create_engine().name == "cpu"
    with pytest.raises(PocketGSError, match=r"devices: none; expected a GPU .* or --engine cpu"):
        create_engine(EngineOptions("webgpu"))


def test_without_wgpu_there_are_no_adapters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "wgpu", None)
    assert adapters.__wrapped__() == ()


@pytest.mark.parametrize("limit", NEEDED)
def test_an_adapter_that_lacks_something_is_refused(
    adapter: Adapter, monkeypatch: pytest.MonkeyPatch, limit: str
) -> None:
    poor = as_gpu(adapter, **{limit: NEEDED[limit] // 2})
    pretend(monkeypatch, poor)
    assert not has_gpu()
    assert create_engine().name == "cpu"
    with pytest.raises(PocketGSError) as refusal:
        create_engine(EngineOptions("webgpu"))
    assert f"Shiny 3000: {limit} {NEEDED[limit] // 2} (expected {NEEDED[limit]})" in str(refusal.value)
    assert len(as_gpu(adapter, **dict.fromkeys(NEEDED, 1)).lacks()) == len(NEEDED)


def test_a_gpu_that_will_do_is_preferred_to_a_better_one_that_will_not(
    adapter: Adapter, monkeypatch: pytest.MonkeyPatch
) -> None:
    poor = as_gpu(adapter, **{"max-compute-workgroup-storage-size": 8192})
    pretend(monkeypatch, poor, as_gpu(adapter, "Frugal 12"))
    assert has_gpu()
    assert choose_adapter().name == "Frugal 12"
    with pytest.raises(PocketGSError, match="max-compute-workgroup-storage-size 8192"):
        choose_adapter("shiny")


def test_a_device_has_no_more_than_every_device_must_have(adapter: Adapter) -> None:
    """So tests use no more than what every device offers."""
    device = open_device(adapter)
    assert {name: device.limits[name] for name in NEEDED} == NEEDED
    assert device.limits["max-storage-buffer-binding-size"] == adapter.limits["max-storage-buffer-binding-size"]


def test_a_device_is_opened_once(adapter: Adapter) -> None:
    device = shared_device(adapter)
    assert shared_device(adapter) is device
    assert WebGpuEngine(EngineOptions("webgpu", portable=True)).executor.device is device
    forget_device(device)
    assert shared_device(adapter) is not device


def test_a_feature_that_is_lacking_is_named(adapter: Adapter, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PocketGSError, match="lacks shader-of-dreams"):
        open_device(adapter, frozenset({"shader-of-dreams"}))
    pretend(monkeypatch, replace(adapter, features=frozenset()))
    with pytest.raises(PocketGSError, match="lacks shader-float32-atomic"):
        create_engine(EngineOptions("webgpu", accumulation="atomic"))


def test_no_feature_is_needed_by_default(adapter: Adapter, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, replace(adapter, features=frozenset()))
    engine = create_engine(EngineOptions("webgpu"))
    engine.prepare()
    scene = Gaussians(np.zeros((1, 3)), np.zeros((1, 3)), np.ones((1, 4)), np.zeros(1), np.zeros((1, 1, 3)))
    engine.upload(scene)
    assert engine.render(camera_in_front(8, 8, 8.0)).alpha.max() > 0.1


@pytest.mark.usefixtures("adapter")
def test_looking_for_devices_is_silent_and_leaves_the_environment_alone() -> None:
    program = (
        "import os; from pocketgs.gpu.adapters import adapters; before = dict(os.environ);"
        "print(len(adapters())); assert dict(os.environ) == before"
    )
    environment = {name: value for name, value in os.environ.items() if name not in ("XDG_RUNTIME_DIR", "DISPLAY")}
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == str(len(adapters()))
    assert run.stderr == ""
