"""The built wheel brings its models and configs, the source archive its tests; a checkout's copies come first."""

import configparser
import email
import os
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest
from packaging.requirements import Requirement

from torquebench.robot.library import data_root

CHECKOUT = data_root()


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Folder with the unpacked wheel, as an installation would have it."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=CHECKOUT, check=True, capture_output=True)
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel:
        wheel.extractall(folder / "site")
    return folder / "site"


def python(site, code):
    """Run code that sees the unpacked wheel instead of the checkout."""
    program = f"import sys; sys.path.insert(0, {str(site)!r})\n{code}"
    environment = {name: value for name, value in os.environ.items() if name != "TORQUEBENCH_DATA"}
    return subprocess.run(
        [sys.executable, "-c", program], cwd=site.parent, env=environment, capture_output=True, text=True, check=False
    )


def test_models_and_configs_are_in_the_wheel(installed):
    """Every file of models/ and configs/ is there, byte for byte."""
    for folder in ("models", "configs"):
        for file in (CHECKOUT / folder).rglob("*"):
            if file.is_file():
                copy = installed / "torquebench" / "_data" / file.relative_to(CHECKOUT)
                assert copy.read_bytes() == file.read_bytes(), file


def test_the_pages_parts_are_in_the_wheel_with_their_licences(installed):
    """Every file of the pages: templates, scripts, the bundled libraries and the texts of their licences."""
    for folder in ("templates", "web"):
        for file in (CHECKOUT / "src" / "torquebench" / "report" / folder).rglob("*"):
            if file.is_file():
                copy = installed / "torquebench" / file.relative_to(CHECKOUT / "src" / "torquebench")
                assert copy.read_bytes() == file.read_bytes(), file
    assert (installed / "torquebench" / "report" / "web" / "libraries" / "three.LICENSE").is_file()


def test_an_installation_finds_its_own_data(installed):
    """Outside the checkout the wheel's own models are used, and a config that names one loads."""
    code = (
        "import torquebench\n"
        "from torquebench.robot.library import data_root, model_names\n"
        "from torquebench.experiment import load_experiment\n"
        "print(data_root(), model_names())\n"
        "print(load_experiment(data_root() / 'configs' / 'paper' / 'fig9-chattering.yaml').n)"
    )
    done = python(installed, code)
    assert done.returncode == 0, done.stderr
    where, count = done.stdout.splitlines()
    assert where.startswith(str(installed))
    assert "puma560" in where
    assert count == "6"


def test_an_installation_runs_a_shipped_config_elsewhere(installed):
    """From a folder that holds nothing, the wheel's own config is run by name, page included."""
    words = ["run", "two-link", "--no-figures", "--out", "r"]
    done = python(installed, f"import sys; from torquebench.cli.app import main; sys.exit(main({words!r}))")
    assert done.returncode == 0, done.stderr
    assert {"manifest.json", "metrics.json"} <= {file.name for file in (installed.parent / "r").iterdir()}


def test_the_wheel_is_for_every_system_and_names_its_licences(installed):
    """It is tagged py3-none-any, and each vendored library lies beside the licence it is given under."""
    facts = next(installed.glob("*.dist-info"))
    assert "Tag: py3-none-any" in (facts / "WHEEL").read_text()
    assert (facts / "licenses" / "LICENSE").read_bytes() == (CHECKOUT / "LICENSE").read_bytes()
    libraries = list((installed / "torquebench" / "report" / "web" / "libraries").glob("*.js"))
    assert libraries
    for library in libraries:
        assert library.with_suffix(".LICENSE").is_file(), library


def test_the_checkout_wins(installed):
    """From the checkout's source, data come from the checkout, whatever else is installed."""
    done = python(CHECKOUT / "src", "from torquebench.robot.library import data_root; print(data_root())")
    assert done.stdout.strip() == str(CHECKOUT)


def test_what_uvx_and_pipx_need_of_the_wheel(installed):
    """They install what it requires, all that pyproject.toml names, and start its one program."""
    facts = next(installed.glob("*.dist-info"))
    asked = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    metadata = email.message_from_string((facts / "METADATA").read_text())
    required = {Requirement(text) for text in metadata.get_all("Requires-Dist")}
    assert {one for one in required if one.marker is None} == {Requirement(text) for text in asked["dependencies"]}
    assert set(metadata.get_all("Provides-Extra")) == set(asked["optional-dependencies"])
    programs = configparser.ConfigParser()
    programs.read_string((facts / "entry_points.txt").read_text())
    assert dict(programs["console_scripts"]) == {"torquebench": "torquebench.__main__:start"}
    start = (
        "import sys; sys.argv = ['torquebench', '--version']; from torquebench.__main__ import start; sys.exit(start())"
    )
    done = python(installed, start)
    assert (done.returncode, done.stdout.split()) == (0, ["torquebench", metadata["Version"]]), done.stderr


@pytest.mark.skipif(not (CHECKOUT / ".git").exists(), reason="git says which files are the checkout's")
def test_the_source_archive_has_what_its_tests_need(tmp_path):
    """Every tracked file is in it but the hooks of git, so that tests run from the archive as from a clone."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(tmp_path)]
    subprocess.run(build, cwd=CHECKOUT, check=True, capture_output=True)
    with tarfile.open(next(tmp_path.glob("*.tar.gz"))) as archive:
        packed = {name.partition("/")[2] for name in archive.getnames()}
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=CHECKOUT, check=True, capture_output=True, text=True).stdout
    assert set(listed.split("\0")) - packed - {""} == {".pre-commit-config.yaml"}
