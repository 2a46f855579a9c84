"""The wheel, installed where there is no checkout: the service runs, a comparison is computed, the page is there."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path
from zipfile import ZipFile

import httpx
import pytest

from tests.api.conftest import free_port

ROOT = Path(__file__).parents[1]

GIT = shutil.which("git")

pytestmark = pytest.mark.skipif(GIT is None, reason="there is no git to say what belongs to the source")

SIZE_MAX = 5_000_000
"""A wheel of text has no need of more [bytes]."""

COMPARE = """
import sys
from api import client
found = client.Service(url=sys.argv[1]).compare(["S1"], ["logic", "minlp1"]).wait().results()
print(client.__file__)
print(*found["t_total"])
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of this version, built from what is under version control."""
    source, built = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    listed = subprocess.run([GIT, "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file() and not name.startswith(("docs/", "tests/")):
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", built, source]
    subprocess.run(build, check=True, cwd=built)
    (found,) = built.glob("hrs_twin-*.whl")
    return found


@pytest.fixture(scope="module")
def bare(wheel, tmp_path_factory):
    """A virtual environment with the wheel, its dependencies those of this one; no checkout is on its path."""
    folder = tmp_path_factory.mktemp("bare") / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    python = folder / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index", wheel]
    subprocess.run(install, check=True)
    packages = next((folder / "lib").glob("python*/site-packages"))
    # A line of a .pth is a folder on the path, whose own .pth files, the editable installation's, are not read.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder


@pytest.mark.slow
def test_the_wheel_is_small_and_whole(wheel):
    assert wheel.stat().st_size < SIZE_MAX
    names = set(ZipFile(wheel).namelist())
    rooms = ("api", "station", "theory", "controllers", "benchmarks/*.py", "benchmarks/data")
    listed = subprocess.run(
        [GIT, "ls-files", *rooms], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    assert [name for name in listed if (ROOT / name).is_file() and name not in names] == []
    assert [name for name in names if name.startswith(("tests", "docs"))] == []


@pytest.mark.full  # its kernels are compiled anew: 90 s of CPU
def test_the_main_job_runs_in_a_bare_environment(bare, tmp_path):
    port, zenoh = free_port(), free_port()
    environment = {"PATH": os.environ["PATH"], "HOME": str(tmp_path), "no_proxy": "*"}
    command = [
        bare / "bin" / "hrs", "serve", "--demo", "--port", str(port), "--workers", "1", "--data", tmp_path / "data",
        "--zenoh-listen", f"tcp/127.0.0.1:{zenoh}",
    ]  # fmt: skip
    service = subprocess.Popen(command, cwd=tmp_path, env=environment, text=True, stdout=subprocess.PIPE)
    try:
        for line in service.stdout:
            if line.startswith("  data"):
                break
        else:
            pytest.fail("the service ended before it was ready")
        url = f"http://127.0.0.1:{port}"
        compared = subprocess.run(
            [bare / "bin" / "python", "-c", COMPARE, url], cwd=tmp_path, env=environment, text=True, check=True,
            capture_output=True, timeout=300,
        )  # fmt: skip
        place, figures = compared.stdout.splitlines()
        assert Path(place).is_relative_to(bare)
        assert [round(float(figure)) for figure in figures.split()] == [1054, 846]
        page = httpx.get(f"{url}/", trust_env=False)
        assert "<title>" in page.text
        assert httpx.get(f"{url}/static/app.js", trust_env=False).status_code == 200
        assert httpx.get(f"{url}/v1/twins/demo", trust_env=False).json()["state"] == "running"
    finally:
        service.send_signal(signal.SIGTERM)
        service.communicate(timeout=60)
    assert service.returncode == 0
