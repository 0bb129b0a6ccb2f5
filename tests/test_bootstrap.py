"""The bootstrap's decisions: when to do nothing, what to download, and what to tell the user. No network."""

from __future__ import annotations

import hashlib
import importlib
import json
import re
import ssl
import sys
import urllib.error
from email.message import Message
from pathlib import Path
from types import ModuleType

import pytest

TOOLS = Path(__file__).resolve().parent.parent / "tools"


@pytest.fixture
def bootstrap(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("bootstrap")


@pytest.fixture
def certificates(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("certificates")


def test_stamp_is_current_for_the_same_project_and_fewer_extras(bootstrap: ModuleType, tmp_path: Path) -> None:
    stamp = tmp_path / "bootstrap.json"
    stamp.write_text(json.dumps({"key": "abc", "extras": ["dev", "lpips"]}))
    assert bootstrap.is_current(stamp, "abc", ["dev"])
    assert bootstrap.is_current(stamp, "abc", [])
    assert not bootstrap.is_current(stamp, "abc", ["docs"])
    assert not bootstrap.is_current(stamp, "other", ["dev"])


@pytest.mark.parametrize("contents", [None, "", "{", '{"key": "other"}'])
def test_stamp_that_says_nothing(bootstrap: ModuleType, tmp_path: Path, contents: str | None) -> None:
    stamp = tmp_path / "bootstrap.json"
    if contents is not None:
        stamp.write_text(contents)
    assert not bootstrap.is_current(stamp, "abc", [])


def test_key_follows_the_project_file(bootstrap: ModuleType, tmp_path: Path) -> None:
    project = tmp_path / "pyproject.toml"
    project.write_text("one")
    key = bootstrap.stamp_key(project)
    assert bootstrap.stamp_key(project) == key
    project.write_text("two")
    assert bootstrap.stamp_key(project) != key


def test_nothing_is_done_when_nothing_changed(
    bootstrap: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stamp = tmp_path / "bootstrap.json"
    stamp.write_text(json.dumps({"key": bootstrap.stamp_key(bootstrap.ROOT / "pyproject.toml"), "extras": ["dev"]}))
    monkeypatch.setattr(bootstrap, "STAMP", stamp)
    monkeypatch.setattr(bootstrap, "PYTHON", Path(sys.executable))
    monkeypatch.setattr(bootstrap.subprocess, "run", lambda *_, **__: pytest.fail("something was run"))
    bootstrap.main(["dev"])
    bootstrap.main([])


def test_extras_add_up(bootstrap: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stamp = tmp_path / "bootstrap.json"
    stamp.write_text(json.dumps({"key": "old", "extras": ["lpips"]}))
    calls = []
    monkeypatch.setattr(bootstrap, "STAMP", stamp)
    monkeypatch.setattr(bootstrap, "PYTHON", Path(sys.executable))
    monkeypatch.setattr(bootstrap, "has_pip", lambda: True)
    monkeypatch.setattr(bootstrap, "certificate_bundle", lambda _: None)
    monkeypatch.setattr(bootstrap, "run_pip", lambda _, arguments, __: calls.append(arguments))
    bootstrap.main(["dev"])
    assert calls == [["install", "--editable", f"{bootstrap.ROOT}[dev,lpips]"]]
    assert json.loads(stamp.read_text())["extras"] == ["dev", "lpips"]


def test_old_python_is_named(bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bootstrap, "OLDEST_PYTHON", (99, 0))
    with pytest.raises(bootstrap.BootstrapError, match="found, expected"):
        bootstrap.main([])


@pytest.mark.parametrize(
    ("link", "address"),
    [
        ("../../files/{}#sha256=00", "https://index/files/{}"),
        ("https://elsewhere/a&amp;b/{}", "https://elsewhere/a&b/{}"),
    ],
)
def test_wheel_is_found_on_an_index_page(bootstrap: ModuleType, link: str, address: str) -> None:
    wheel = bootstrap.PIP_WHEEL
    page = f'<a href="pip-0.1.tar.gz">pip-0.1.tar.gz</a>\n<a href="{link.format(wheel)}">{wheel}</a>'
    assert bootstrap.wheel_address(page, "https://index/simple/pip/") == address.format(wheel)


def test_index_without_the_wheel(bootstrap: ModuleType) -> None:
    with pytest.raises(bootstrap.BootstrapError, match="does not list pip-"):
        bootstrap.wheel_address("<html></html>", "https://index/simple/pip/")


def test_wheel_with_another_hash_is_refused(
    bootstrap: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIP_INDEX_URL", "https://mirror/simple/")
    page = f'<a href="{bootstrap.PIP_WHEEL}">'.encode()
    asked = []
    monkeypatch.setattr(bootstrap, "download", lambda address, _: asked.append(address) or page)
    with pytest.raises(bootstrap.BootstrapError, match=hashlib.sha256(page).hexdigest()):
        bootstrap.install_pip(tmp_path / "pip.whl", None)
    assert asked[0] == "https://mirror/simple/pip/"
    assert not (tmp_path / "pip.whl").exists()


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (urllib.error.URLError(OSError("no route to host")), "is there a network connection"),
        (urllib.error.URLError(ssl.SSLCertVerificationError("self-signed")), "apt install ca-certificates"),
        (urllib.error.HTTPError("https://index", 404, "Not Found", Message(), None), "answered 404 Not Found"),
        (TimeoutError("timed out"), "timed out"),
    ],
)
def test_failed_download_is_explained(bootstrap: ModuleType, error: Exception, message: str) -> None:
    explained = bootstrap.download_failure("https://index", error)
    assert message in explained
    assert explained.startswith("https://index: ")
    assert "\n" not in explained


def test_certificates_that_the_user_names_come_first(
    certificates: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named, system, fallback = (tmp_path / name for name in ("named.pem", "system.pem", "fallback.pem"))
    monkeypatch.setattr(certificates, "BUNDLES", (str(system),))
    monkeypatch.setattr(certificates.shutil, "which", lambda _: None)
    monkeypatch.setattr(certificates.ssl, "get_default_verify_paths", lambda: ssl.DefaultVerifyPaths(*[None] * 6))
    monkeypatch.delenv("SSL_CERT_FILE", raising=False)
    monkeypatch.setenv("PIP_CERT", str(named))
    assert certificates.certificate_bundle(fallback) is None
    for path in (fallback, system, named):
        path.touch()
        assert certificates.certificate_bundle(fallback) == str(path)


@pytest.mark.parametrize(
    ("extras", "expected"), [([], "280 MB"), (["bench", "dev"], "280 MB"), (["dev", "gsplat"], "7 GB on the disk")]
)
def test_the_size_of_what_is_downloaded(bootstrap: ModuleType, extras: list[str], expected: str) -> None:
    assert expected in bootstrap.download_size(extras)


def test_the_extras_that_need_pytorch(bootstrap: ModuleType) -> None:
    text = (bootstrap.ROOT / "pyproject.toml").read_text(encoding="utf-8")
    section = text[text.index("[project.optional-dependencies]") : text.index("[project.scripts]")]
    extras = re.findall(r"^(\w+) = \[(.*?)\]", section, re.M | re.S)
    needing = {name for name, packages in extras if "torch>" in packages or "lpips" in packages}
    assert needing == bootstrap.WITH_PYTORCH
