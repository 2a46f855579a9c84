"""The examples of docs/ against a running service, and the files that put it into containers."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import compose_spec
import pytest

from api.settings import Settings

ROOT = Path(__file__).parents[2]
CLIENTS = ROOT / "docs" / "examples" / "clients"


def _run(*command, **more):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=120, check=False, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_example_with_httpx(service):
    said = _run(sys.executable, CLIENTS / "with_httpx.py", service.url)
    assert len(re.findall(r"^(?:S1|rush) ", said, re.MULTILINE)) == 20
    assert "compressor 1517 s" in said
    assert "0 s   886.8 bar" in said


def test_the_example_with_a_generated_client(service, tmp_path):
    generator = Path(sys.executable).with_name("openapi-python-client")
    environment = {**os.environ, "PATH": f"{generator.parent}{os.pathsep}{os.environ['PATH']}"}
    command = [generator, "generate", "--url", f"{service.url}/openapi.json", "--meta", "none"]
    said = _run(*command, "--output-path", tmp_path / "hrs_client", env=environment)
    assert "Warning" not in said
    environment["PYTHONPATH"] = str(tmp_path)
    said = _run(sys.executable, CLIENTS / "with_generated.py", service.url, env=environment)
    assert "succeeded: waits 846 s in all" in said
    assert said.rstrip().endswith("stopped")


@pytest.fixture(scope="module")
def compose():
    return compose_spec.PyCompose.from_yaml((ROOT / "docker-compose.yml").read_text())


def test_the_compose_file_keeps_to_the_specification(compose):
    assert set(compose.services) == {"hrs", "postgres", "zenoh"}
    for service in compose.services.values():
        for port in service.ports or []:
            assert "127.0.0.1" in str(port)
    wrong = (ROOT / "docker-compose.yml").read_text().replace("    command:", "    commandd:")
    with pytest.raises(ValueError, match="commandd"):
        compose_spec.PyCompose.from_yaml(wrong)


def test_the_variables_of_the_containers_are_settings(compose):
    in_image = re.findall(r"\b(HRS_\w+)=", (ROOT / "Dockerfile").read_text())
    given = {*compose.services["hrs"].environment, *in_image}
    assert given == {"HRS_DATABASE", "HRS_ZENOH_CONNECT", "HRS_DATA"}
    assert {name.removeprefix("HRS_").lower() for name in given} <= set(Settings.model_fields)


def test_the_commands_of_the_containers_are_commands(compose, tmp_path):
    """`hrs serve ...` of both files parses, but for the key that it asks for."""
    in_image = re.search(r"^CMD (\[.*\])$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    for command in (compose.services["hrs"].command, shlex.split(re.sub(r'[\[\],"]', " ", in_image[1]))):
        words = [Path(sys.executable).with_name(command[0]), *command[1:]]
        environment = {**os.environ, "HRS_DATA": str(tmp_path)}
        done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False, env=environment)
        assert done.returncode == 2
        assert "hrs keys create" in done.stderr
