"""Only kernels whose own sources changed are compiled again, and a stale one is never found."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from station import kernel_cache

ROOT = Path(__file__).parents[2]

FORMULA = '''"""A formula."""
from importlib.resources import files
from station.compiled import formula

MORE = float((files("station") / "data" / "gas.txt").read_text())

@formula
def twice(x):
    return 2.0 * x + MORE
'''

KERNEL = '''"""A kernel."""
from numba import types
from station.compiled import entry
from station.gas import twice

@entry(types.float64(types.float64))
def {name}(x):
    """A docstring."""
    return twice(x) + {more}
'''

INNER = '''"""A kernel that another calls."""
from numba import types
from station.compiled import entry, kernel

@kernel
def inner(x, more=1.0):
    return x + more

@entry(types.float64(types.float64))
def outer(x):
    return 2.0 * inner(x)
'''

CALLED = """
import json
from controllers.c import inner, outer
found = [outer(1.0), "_called" in vars(inner), inner(1.0), inner(1.0), inner(2, more=3)]
refused = 0
for wrong in ((), (1.0, 2.0, 3.0), ("a",)):
    try:
        inner(*wrong)
    except Exception:
        refused += 1
print(json.dumps([*found, refused, sum(inner._called.stats.cache_hits.values())]))
"""

RUN = """
import json
from controllers.a import a
from controllers.b import b
print(json.dumps({f.__name__: [f(1.0), sum(f.stats.cache_hits.values())] for f in (a, b)}))
"""


@pytest.fixture
def package(tmp_path):
    """A package of two controllers that share a formula; `run()` gives what they compute, and how often from cache."""
    top = tmp_path / "package"
    for room in ("station", "controllers"):
        (top / room).mkdir(parents=True)
        (top / room / "__init__.py").write_text("")
    for name in ("compiled", "kernel_cache"):
        shutil.copy(ROOT / "station" / f"{name}.py", top / "station")
    (top / "station" / "gas.py").write_text(FORMULA)
    (top / "station" / "data").mkdir()
    (top / "station" / "data" / "gas.txt").write_text("0.0")
    for name, more in (("a", 1.0), ("b", 5.0)):
        (top / "controllers" / f"{name}.py").write_text(KERNEL.format(name=name, more=more))

    def run(code=RUN):
        environment = {**os.environ, "PYTHONPATH": str(top), "XDG_CACHE_HOME": str(tmp_path)}
        environment["PYTHONDONTWRITEBYTECODE"] = "1"  # its files change within the second that bytecode knows them by
        environment.pop("NUMBA_CACHE_DIR", None)
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=top, env=environment, capture_output=True, text=True, check=True
        )
        return json.loads(done.stdout)

    return top, run


def _edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.slow
def test_an_edit_compiles_what_is_made_from_the_edited_file_and_nothing_else(package):
    top, run = package
    assert run() == {"a": [3.0, 0], "b": [7.0, 0]}
    assert run() == {"a": [3.0, 1], "b": [7.0, 1]}
    _edit(top / "controllers" / "a.py", "A docstring.", "Another docstring.")
    assert run() == {"a": [3.0, 0], "b": [7.0, 1]}
    _edit(top / "station" / "gas.py", "2.0 * x", "3.0 * x")
    assert run() == {"a": [4.0, 0], "b": [8.0, 0]}
    _edit(top / "station" / "gas.py", "3.0 * x", "2.0 * x")
    assert run() == {"a": [3.0, 1], "b": [7.0, 1]}  # as it was: what was compiled for it is still there
    _edit(top / "station" / "data" / "gas.txt", "0.0", "10.0")
    assert run() == {"a": [13.0, 0], "b": [17.0, 0]}


@pytest.mark.slow
def test_python_can_call_a_kernel_that_was_compiled_for_kernels(package):
    """It is compiled for Python when Python first calls it, and kept as other kernels are."""
    top, run = package
    (top / "controllers" / "c.py").write_text(INNER)
    assert run(CALLED) == [4.0, False, 2.0, 2.0, 5, 3, 0]
    assert run(CALLED) == [4.0, False, 2.0, 2.0, 5, 3, 2]


def test_a_closure_holds_what_kernels_are_made_from():
    step = kernel_cache.closure("station.step")
    assert {"station.step", "station.shield", "station.valves", "station.limits", "station.plants.thesis"} <= step
    assert "station.plants" in step  # it registers the plants that kernels are compiled for
    assert "controllers.logic" not in step | kernel_cache.closure("controllers.minlp.exact")
    assert kernel_cache.closure("station.bounds.grid").isdisjoint({"station.step", "station.live"})
    assert "station.simulation" in kernel_cache.closure("controllers.certified.box")


@pytest.mark.slow
def test_every_import_is_seen():
    """The closures are those of the modules that a process loads, as far as kernels are made from them."""
    code = "import sys, {module}; print(*sorted(sys.modules))"
    for module in ("station.kernels", "controllers.logic", "controllers.guarded.controller"):
        done = subprocess.run(
            [sys.executable, "-c", code.format(module=module)], cwd=ROOT, capture_output=True, text=True, check=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        loaded = {name for name in done.stdout.split() if name.split(".")[0] in ("station", "controllers")}
        assert loaded <= kernel_cache.closure(module)


def test_data_that_kernels_are_made_from_counts_as_their_source():
    data = {path.name for path in kernel_cache._data("station.plants.real_gas.hydrogen")}
    assert "hydrogen.toml" in data
    assert "station.plants.real_gas.hydrogen" in kernel_cache.closure("station.plants.real_gas.leachman")
    assert kernel_cache._data("station.preset_files") == []  # presets are given to a run


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("from station.limits import (\n    Limit,\n    VALVES,\n)\n", {"station.limits"}),
        ("import station.tube as t, station.whole\n", {"station.tube", "station.whole"}),
        ("def f():\n    from station.plants import thesis\n", {"station.plants", "station.plants.thesis"}),
        ("from station import load_station\n", {"station", "station.preset_files", "station.simulation"}),
        ("from .limits import Limit\nfrom . import tube\n", {"station.limits", "station.tube"}),
    ],
)
def test_imports_are_read_from_the_source(text, found):
    assert found <= set(kernel_cache._imports(text, "station"))
