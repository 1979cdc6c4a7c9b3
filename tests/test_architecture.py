"""The shape of the code base: the house rules that a machine can check."""

import ast
import importlib
import inspect
import os
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from importlib.metadata import packages_distributions
from pathlib import Path
from types import ModuleType

import equinox as eqx
import grimp
import pytest

from tests.sources import PACKAGES, ROOT, trees

packages = pytest.mark.parametrize("package", PACKAGES)


def run(code: str) -> subprocess.CompletedProcess[str]:
    """`code` in a fresh interpreter, without what this process and its environment have set."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "XLA_"))}
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=ROOT, env=environment,
        capture_output=True, text=True,
    )  # fmt: skip


def modules(package: str) -> Iterator[ModuleType]:
    """The package and everything below it, imported."""
    top = importlib.import_module(package)
    yield top
    for found in pkgutil.walk_packages(top.__path__, f"{package}."):
        if not found.name.endswith("__main__"):
            yield importlib.import_module(found.name)


def own_modules() -> list[type[eqx.Module]]:
    """Every `eqx.Module` that our packages define."""
    return sorted(
        {
            value
            for package in PACKAGES
            for module in modules(package)
            for value in vars(module).values()
            if inspect.isclass(value)
            and issubclass(value, eqx.Module)
            and value.__module__ == module.__name__
        },
        key=lambda cls: (cls.__module__, cls.__qualname__),
    )


def is_abstract(cls: type) -> bool:
    return cls.__name__.lstrip("_").startswith("Abstract")


def tracked_files() -> list[Path]:
    """Files git holds or would take in; the test that asks is skipped outside a checkout."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True)
    if listed.returncode:
        pytest.skip("not a git checkout")
    names = listed.stdout.decode().split("\0")
    return [ROOT / name for name in names if name and (ROOT / name).is_file()]


def test_import_names_have_one_owner():
    """Two wheels with one import name overwrite each other silently; an editable one loses."""
    owners = packages_distributions()
    assert {owner for package in PACKAGES for owner in owners.get(package, ())} <= {"hysid"}


def test_modules_are_abstract_or_final():
    """Only an `Abstract...` class is subclassed, and only its abstract members are overridden."""
    ours, faults = own_modules(), []
    for cls in ours:
        for base in set(cls.__mro__[1:]) & set(ours):
            if not is_abstract(base):
                faults.append(f"{cls.__name__} subclasses {base.__name__}, which is final")
            concrete = {
                name
                for name, value in vars(base).items()
                if (inspect.isroutine(value) or isinstance(value, property))
                and (not name.startswith("__") or name == "__call__")
                and name not in base.__abstractmethods__
            }
            overridden = sorted(concrete & set(vars(cls)))
            faults += [f"{cls.__name__} overrides {base.__name__}.{name}" for name in overridden]
        if cls.__abstractmethods__ and not is_abstract(cls):
            faults.append(f"{cls.__name__} is abstract and does not say so")
    assert faults == []


def test_import_has_no_effects_and_that_of_hysteresis_is_light():
    """No output, no warning, and JAX as it was: 64 bits are the application's decision."""
    heavy = ["compensate", "emcee", "identify", "jinja2", "matplotlib", "optimistix", "pandas"]
    heavy += ["pint", "rich", "scipy.signal", "scipy.stats", "typer", "xarray"]
    done = run(
        "import jax, sys\n"
        "before = dict(jax.config.values)\n"
        "from hysteresis import *\n"
        f"assert not set({heavy}) & set(sys.modules), set({heavy}) & set(sys.modules)\n"
        + "".join(f"from {package} import *\n" for package in PACKAGES)
        + "assert jax.config.values == before\n"
        "assert jax.config.jax_enable_x64 is False\n"
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_laws_import_math_alone():
    """Beside types and each other: they run without the rest, and become C."""
    included = {"include_external_packages": True, "exclude_type_checking_imports": True}
    graph = grimp.build_graph("hysteresis", cache_dir=None, **included)
    foreign = {
        (law, name)
        for law in graph.find_children("hysteresis.laws")
        for name in graph.find_modules_directly_imported_by(law)
        if not law.startswith("hysteresis.laws._")
        and not re.match(r"math$|collections$|typing$|hysteresis\.laws\.", name)
    }
    assert foreign == set()


def test_imports_run_in_no_circle():
    """Imports inside functions count: they would only hide the circle."""
    graph = grimp.build_graph(*PACKAGES, exclude_type_checking_imports=True, cache_dir=None)
    imports = {m: graph.find_modules_directly_imported_by(m) for m in graph.modules}
    TopologicalSorter(imports).prepare()


def test_no_path_of_a_machine_is_tracked():
    folders = [f"{ROOT.parent}/", f"{Path.home()}/"]
    machine = re.compile("|".join([r"(?<![\w.])/(work|root|home)/", *map(re.escape, folders)]))
    hits = []
    for path in tracked_files():
        data = path.read_bytes()
        if b"\0" in data:
            continue
        for n, line in enumerate(data.decode("utf-8").splitlines(), start=1):
            if machine.search(line):
                hits.append(f"{path.relative_to(ROOT)}:{n}: {line.strip()}")
    assert hits == []


@packages
def test_everything_public_is_documented(package: str):
    """The public modules, and what they export; `hysteresis.laws` tells what the functions of a law do."""
    bare = []
    for module in modules(package):
        if re.search(r"\._|^hysteresis\.laws\.", module.__name__):
            continue
        exported = {
            f"{module.__name__}.{name}": value
            for name in dir(module)
            if not name.startswith("_")
            and callable(value := getattr(module, name))
            and getattr(value, "__module__", "").split(".")[0] in PACKAGES
        }
        for name, value in {module.__name__: module, **exported}.items():
            text = vars(value).get("__doc__") if inspect.isclass(value) else value.__doc__
            # A dataclass or named tuple without a docstring shows its signature instead.
            if not text or text.startswith(name.rpartition(".")[2] + "("):
                bare.append(name)
    assert bare == []


def test_no_module_decides_by_a_sentence():
    """Wording is free to change: what a program must know is a field or a code.

    A comparison with two words or more, or with a code in brackets, is one with a sentence; also where the
    text is a constant of the module. Readers of files compare with texts that others have written.
    """
    others = ("hysteresis/records/importers/", "compensate/export/_python_to_c99.py")
    codes = {"at bound", "hysid soft sensor"}  # a parameter's status, and the kind of a file
    faults = [
        f"{path}:{line}: {text!r}"
        for path, tree in trees().items()
        if not path.startswith(others)
        for line, text in decisions_by_sentence(tree)
        if text not in codes
    ]
    assert faults == []


def decisions_by_sentence(tree: ast.Module) -> list[tuple[int, str]]:
    """Line and text of each comparison with a sentence, or with the beginning or end of one."""
    texts = {
        target.id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    found = []
    for node in ast.walk(tree):
        parts: list[ast.expr] = []
        if isinstance(node, ast.Compare):
            parts = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ASKS:
            parts = node.args
        parts = [texts.get(p.id, p) if isinstance(p, ast.Name) else p for p in parts]
        parts = [q for p in parts for q in (p.elts if isinstance(p, ast.Tuple) else [p])]
        said = [p.value for p in parts if isinstance(p, ast.Constant) and isinstance(p.value, str)]
        found += [(node.lineno, text) for text in said if SENTENCE.search(text)]
    return sorted(found)


ASKS = ("startswith", "endswith", "find", "search", "match")
SENTENCE = re.compile(r"[A-Za-z]{2,}[,:;]? [A-Za-z]{2,}|^\[[a-z-]+\]$")
