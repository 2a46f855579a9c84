"""Every command that README, CONTRIBUTING, tutorials, how-tos and the pages of theory show is run, and prints that.

A page's blocks are done in their order, in a folder of their own with `docs/examples` beside it:

- a fenced block with `title="NAME"` is a file the reader writes;
- of a block with lines `$ COMMAND` the other lines are what is printed, `[...]` standing for what is left out;
- without such lines each line that begins as a command does is one;
- a comment `<!-- varies: 12.3; ID -->` before a block names texts that are others each time (times, ids);
- a Python block with `>>>` is a session.

A page that shows `./run` alone talks to a service, which is started once for this file.
"""

from __future__ import annotations

import doctest
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.api.conftest import RunningService
from tests.shown import agree

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
    *(ROOT / "docs" / name for name in ("theory.md", "predictive.md")),
]

NOT_RUN = {
    "./run": "installs, then serves until it is interrupted; what it prints is compared with the service of this file",
    "./run test": "runs the tests, this one too",
    "./run check": "continuous integration runs it",
    "./run docs": "continuous integration runs it",
    ". .venv/bin/activate": "the commands run here in the environment of the tests",
}
"""Commands that are shown and not run, each with its reason; `./run test FILE...` runs tests that run anyhow."""

SLOW = {
    "docs/theory.md": "proofs and their checks",
    "docs/tutorials/first-certificate.md": "a certificate of service",
    "docs/howto/plant.md": "kernels are compiled",
    "docs/tutorials/first-subscriber.md": "a service, and programs that subscribe to it",
    "docs/tutorials/follow-a-station.md": "a calibration",
    "docs/tutorials/first-comparison.md": "a comparison with replications",
    "docs/tutorials/first-controller.md": "a package is installed, and the service started with it",
    "docs/howto/compiled-controller.md": "kernels are compiled",
}
"""Pages that take more than some seconds of CPU, with the reason."""

FULL = {"docs/predictive.md": "hundreds of closed loops: some 100 s of CPU"}
"""Pages that take minutes, with the reason."""

BEGINNINGS = ("hrs ", "./run", "python ", "pip ", "curl ", ". ")


class Block(NamedTuple):
    """A code block of a page."""

    info: str
    lines: list[str]
    varies: list[str]

    @property
    def title(self) -> str | None:
        """The name of the file that it shows."""
        found = re.search(r'title="([^"]+)"', self.info)
        return found[1] if found else None


class Command(NamedTuple):
    """A command, and what it is shown to print; None where nothing is shown."""

    text: str
    shown: list[str] | None


def blocks_of(text: str) -> Iterator[Block]:
    """Fenced blocks, and indented ones that begin as commands do."""
    varies: list[str] = []
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith("```"):
            fence = list(iter(lambda: next(lines), "```"))
            yield Block(line.strip("`"), fence, varies)
            varies = []
        elif line.startswith("<!-- varies:"):
            varies = [each.strip() for each in line.removeprefix("<!-- varies:").removesuffix("-->").split(";")]
        elif line.startswith(("    $ ", *(f"    {word}" for word in BEGINNINGS))):
            block = [line[4:]]
            for rest in lines:
                if not rest.startswith("    "):
                    break
                block.append(rest[4:])
            yield Block("", block, varies)
            varies = []


def commands_of(block: Block) -> list[Command]:
    """The commands of a block; none in a file, in output alone, or in another language."""
    if block.title or block.info not in {"", "console", "sh", "bash"}:
        return []
    if not any(line.startswith("$ ") for line in block.lines):
        return [Command(_uncommented(line), None) for line in block.lines if line.startswith(BEGINNINGS)]
    found: list[Command] = []
    for line in block.lines:
        if line.startswith("$ "):
            found.append(Command(_uncommented(line[2:]), []))
        elif found and found[-1].text.endswith("\\"):
            found[-1] = Command(found[-1].text[:-1] + line.strip(), [])
        elif found:
            found[-1].shown.append(line)  # type: ignore[union-attr]
    return found


def _uncommented(command: str) -> str:
    return re.sub(r"\s+# .*", "", command).strip()


def _is_run(command: str) -> bool:
    return command not in NOT_RUN and not command.startswith("./run test ")


class Reader:
    """A reader of one page: a folder with the examples, and an environment in which `hrs` is the one under test."""

    def __init__(self, folder: Path, service: RunningService | None) -> None:
        self.folder, self.service = folder, service
        self._ports = {}
        if service is not None:
            self._ports = {"8000": str(service.port), "7447": service.zenoh.rpartition(":")[2]}
        self._site = folder / ".site"
        self._site.mkdir()
        shutil.copytree(
            ROOT / "docs" / "examples", folder / "docs" / "examples", ignore=shutil.ignore_patterns("__pycache__")
        )
        for path in (folder / "docs" / "examples").rglob("*.py"):
            path.write_text(self.translated(path.read_text()))
        self._environment = {
            **os.environ,
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join([str(self._site), str(ROOT)]),
            "HRS_DATA": str(folder / "data"),
            "COLUMNS": "140",
            "no_proxy": "*",
        }
        if service is not None:
            self._environment |= {"HRS_URL": service.url, "HRS_ZENOH_CONNECT": service.zenoh}

    def translated(self, text: str, *, back: bool = False) -> str:
        """The usual ports as those of the service, or back."""
        for usual, ours in self._ports.items():
            text = text.replace(f":{ours}" if back else f":{usual}", f":{usual}" if back else f":{ours}")
        return text

    def write(self, name: str, lines: list[str]) -> None:
        """Write a file that the page shows."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.translated("\n".join(lines) + "\n"))

    def run(self, command: Command, varies: list[str]) -> None:
        """Run a command and compare what it prints."""
        if command.text == "./run" and command.shown and self.service is not None:
            agree(command.shown, self.translated("".join(self.service.said), back=True), varies)
        if not _is_run(command.text):
            return
        if installed := re.fullmatch(r"pip install (?:-e )?(\S+)", command.text):
            self._install(self.folder / installed[1])
            return
        text = re.sub(r"^\./run ", "hrs ", command.text)
        done = subprocess.run(
            ["/bin/bash", "-c", self.translated(text)], cwd=self.folder, env=self._environment, timeout=300,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
        )  # fmt: skip
        output = self.translated(done.stdout, back=True)
        assert done.returncode == 0, f"{command.text}\n{output}"
        if command.shown is not None and any(line.strip() for line in command.shown):
            agree(command.shown, output, varies)

    def _install(self, folder: Path) -> None:
        """Install a package's modules and entry points by hand, as pip would, but without a network."""
        document = tomllib.loads((folder / "pyproject.toml").read_text())
        project = document["project"]
        for module in document["tool"]["setuptools"]["py-modules"]:
            shutil.copy(folder / f"{module}.py", self._site)
        about = self._site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
        about.mkdir(exist_ok=True)
        (about / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
        )
        points = project["entry-points"]["hrs.controllers"]
        lines = ["[hrs.controllers]", *(f"{name} = {value}" for name, value in points.items())]
        (about / "entry_points.txt").write_text("\n".join(lines) + "\n")


def _serves(page: Path) -> bool:
    commands = [command.text for block in blocks_of(page.read_text()) for command in commands_of(block)]
    return "./run" in commands and page.name != "README.md"


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """The service that `./run` starts, with its demonstration, on other ports."""
    running = RunningService(tmp_path_factory.mktemp("demo"), "--demo", "--workers", "1")
    until = time.monotonic() + 30
    while not any(line.startswith("  first job") for line in running.said) and time.monotonic() < until:
        time.sleep(0.05)
    yield running
    running.stop()


def _marked(page: Path):
    name = str(page.relative_to(ROOT))
    marks = [pytest.mark.full] if name in FULL else [pytest.mark.slow] if name in SLOW else []
    return pytest.param(page, id=name, marks=marks)


@pytest.mark.slow
@pytest.mark.parametrize("page", [_marked(page) for page in PAGES])
def test_what_a_page_shows_happens(page, tmp_path, request):
    reader = Reader(tmp_path, request.getfixturevalue("demo") if _serves(page) else None)
    names: dict[str, object] = {}
    for block in blocks_of(page.read_text()):
        if block.title:
            reader.write(block.title, block.lines)
        elif block.info == "python" and block.lines[0].startswith(">>> "):
            session = doctest.DocTestParser().get_doctest("\n".join(block.lines) + "\n", names, page.name, None, 0)
            flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
            assert doctest.DocTestRunner(optionflags=flags).run(session, clear_globs=False).failed == 0
            names |= session.globs
        for command in commands_of(block):
            reader.run(command, block.varies)


def test_no_command_is_hidden():
    """What looks like a command of ours stands in a block that is understood."""
    for page in PAGES:
        text = page.read_text()
        known = {line.strip() for block in blocks_of(text) for line in block.lines}
        looks = {line.strip() for line in text.splitlines() if re.match(r"\s*(\$ |hrs |\./run )", line)}
        assert looks - known == set(), page


def test_what_is_not_run_is_shown():
    shown = {command.text for page in PAGES for block in blocks_of(page.read_text()) for command in commands_of(block)}
    assert set(NOT_RUN) <= shown
    assert set(SLOW) <= {str(page.relative_to(ROOT)) for page in PAGES}


def test_the_tests_that_are_named_are_there():
    shown = {command.text for page in PAGES for block in blocks_of(page.read_text()) for command in commands_of(block)}
    named = [path for text in shown if text.startswith("./run test ") for path in text.split()[2:]]
    assert named
    assert [path for path in named if not (ROOT / path).exists()] == []
