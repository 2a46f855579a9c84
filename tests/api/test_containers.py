"""The compose files without Docker: they obey the specification, and name settings and commands that are there."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
import typer
import yaml
from compose_spec import ComposeSpecification, Service

from api.cli.main import app
from api.settings import Settings
from tests.api.conftest import RunningService

ROOT = Path(__file__).parents[2]
FILES = ("docker-compose.yml", "docker-compose.zenoh.yml")
PARTS = {name: yaml.safe_load((ROOT / name).read_text()) for name in FILES}
BASE, OVER = PARTS.values()


@pytest.mark.parametrize("name", FILES)
def test_they_obey_the_specification(name):
    ComposeSpecification.model_validate(PARTS[name])
    for service in PARTS[name]["services"].values():  # which that lets through with any further word
        assert set(service) <= set(Service.model_fields)
    with pytest.raises(ValueError, match="healthcheck"):
        ComposeSpecification.model_validate({"services": {"hrs": {"image": "x", "healthcheck": "often"}}})


def test_every_service_has_a_health_check_and_keeps_what_it_must():
    for name, service in BASE["services"].items():
        assert service["healthcheck"]["test"][0] == "CMD", name
        assert service["security_opt"] == ["no-new-privileges:true"]
        kept = [volume.split(":")[0] for volume in service["volumes"]]
        given = [volume for volume in service["volumes"] if volume.startswith("./")]
        assert set(kept) <= set(BASE["volumes"]) | {volume.split(":")[0] for volume in given}, name
        assert all(volume.endswith(":ro") and (ROOT / volume.split(":")[0]).is_dir() for volume in given), name
        for other, wanted in service.get("depends_on", {}).items():
            assert wanted == {"condition": "service_healthy"}
            assert "healthcheck" in BASE["services"][other]
    hrs = BASE["services"]["hrs"]
    assert (hrs["read_only"], hrs["cap_drop"]) == (True, ["ALL"])
    assert hrs["ports"] == ["127.0.0.1:8000:8000"]


def test_the_variables_are_settings():
    given = BASE["services"]["hrs"]["environment"] | OVER["services"]["hrs"]["environment"]
    named = {variable.removeprefix("HRS_").lower(): value for variable, value in given.items()}
    assert set(named) <= set(Settings.model_fields)
    settings = Settings(**{name: re.sub(r"\$\{\w+[^}]*\}", "secret", str(value)) for name, value in named.items()})
    assert settings.zenoh_keys_required
    dockerfile = (ROOT / "Dockerfile").read_text()
    assert {name.lower() for name in re.findall(r"\bHRS_(\w+)=", dockerfile)} <= set(Settings.model_fields)
    mounted = [volume.split(":")[1] for volume in OVER["services"]["hrs"]["volumes"]]
    assert [str(settings.zenoh_certificate.parent), str(settings.zenoh_private_key.parent)] == mounted * 2


def _parsed(words):
    command = typer.main.get_command(app)
    name, found, rest = command.resolve_command(None, words)
    while hasattr(found, "resolve_command"):
        name, found, rest = found.resolve_command(None, rest)
    return found.make_context(name, rest)


def test_the_commands_are_ours():
    said = [BASE["services"]["hrs"]["command"]]
    heads = [line for name in FILES for line in (ROOT / name).read_text().splitlines() if line.startswith("#")]
    said += [re.split("[#>]", line.split("hrs hrs", 1)[1])[0].split() for line in heads if "hrs hrs" in line]
    parsed = [_parsed(words[1:] if words[0] == "hrs" else words) for words in said]
    assert [context.info_name for context in parsed] == ["serve", "create", "create", "zenoh"]
    assert parsed[0].params["host"] == "0.0.0.0"  # noqa: S104  # in the container
    with pytest.raises(Exception, match="No such option"):
        _parsed(["serve", "--hosst", "x"])


@pytest.mark.slow
def test_the_health_check_tells_who_is_ready(tmp_path):
    """The very command, but for the port and the path to Python."""
    import sys

    service = RunningService(tmp_path, "--workers", "0")
    _, _, option, code = BASE["services"]["hrs"]["healthcheck"]["test"]
    command = [sys.executable, option, code.replace("127.0.0.1:8000", f"127.0.0.1:{service.port}")]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
    finally:
        service.stop()
    assert subprocess.run(command, capture_output=True, timeout=60, check=False).returncode != 0
