"""What a built wheel holds, and that it finds its own files."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = sorted(
    path.relative_to(ROOT).as_posix()
    for folder in ("config", "systemd")
    for path in (ROOT / folder).rglob("*")
    if path.is_file()
)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
        timeout=60,
    )
    (built,) = folder.glob("*.whl")
    return zipfile.ZipFile(built)


def test_what_a_person_edits_and_what_boots_it_ship_as_data_files(wheel: zipfile.ZipFile) -> None:
    assert {f"companion/data/{name}" for name in SHIPPED} <= set(wheel.namelist())
    assert {"config/companion.toml", "systemd/companion.service", "systemd/install.sh"} <= set(SHIPPED)


def test_the_page_ships_with_all_its_files(wheel: zipfile.ZipFile) -> None:
    folders = ("companion/observers/page/static", "companion/pages/static", "companion/desk/drives/static")
    files = {path.relative_to(ROOT).as_posix() for name in folders for path in (ROOT / name).iterdir()}
    assert {
        f"companion/observers/page/static/{name}" for name in ("index.html", "main.js", "style.css")
    } <= files
    assert files <= set(wheel.namelist())


def test_only_the_three_packages_are_modules(wheel: zipfile.ZipFile) -> None:
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {
        "anytraverse",
        "companion",
        "gcs_plugin",
    }


def test_the_wheel_is_typed_and_carries_its_licence(wheel: zipfile.ZipFile) -> None:
    names = set(wheel.namelist())
    assert {"anytraverse/py.typed", "companion/py.typed", "gcs_plugin/py.typed"} <= names
    (licence,) = (name for name in names if name.endswith("/LICENSE"))
    assert b"Apache License" in wheel.read(licence)


@pytest.mark.parametrize("name", ["config/companion.toml", "systemd/install.sh", "config"])
def test_an_unpacked_wheel_finds_its_own_files_beside_foreign_ones(
    wheel: zipfile.ZipFile, tmp_path: Path, name: str
) -> None:
    wheel.extractall(tmp_path)
    (tmp_path / "config").mkdir()
    (tmp_path / "config/companion.toml").write_text("somebody else's")
    found = subprocess.run(
        [sys.executable, "-c", f"from anytraverse.resources import resource; print(resource({name!r}))"],
        cwd=tmp_path,
        env={"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    assert Path(found.stdout.strip()) == tmp_path / "companion/data" / name
