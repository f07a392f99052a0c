"""What the code of a package imports stands in its package.xml, and nothing else: read from the sources alone."""

from __future__ import annotations

import ast
import re
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml

WORKSPACE = Path(__file__).resolve().parents[1]
PACKAGES = sorted(path.parent.name for path in WORKSPACE.glob("src/*/setup.py"))
# Import name -> rosdep key, as in rosdep/python.yaml of ros/rosdistro.
ROSDEP_KEYS = {
    "PIL": "python3-pil",
    "click": "python3-click",
    "ezdxf": "python3-ezdxf",
    "hypothesis": "python3-hypothesis",
    "matplotlib": "python3-matplotlib",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
}
# Import name -> name on PyPI, where rosdep has no key: package.xml names these in a comment.
PYPI_ONLY = {
    "casadi": "casadi",
    "lz4": "lz4",
    "mcap": "mcap",
    "pyarrow": "pyarrow",
    "rerun": "rerun-sdk",
    "zstandard": "zstandard",
}
# Where the name on PyPI is neither the import name nor the rosdep key without python3-.
ON_PYPI = {"PIL": "pillow", "yaml": "pyyaml"} | PYPI_ONLY
PYPI_COMMENT = re.compile(r"<!-- Without a rosdep key, from requirements/: ([a-z0-9, -]+?)\. -->")


def imports_of(files: Iterable[Path]) -> set[str]:
    """Packages that files import at any place, without the standard library."""
    found: set[str] = set()
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add((node.module or "").partition(".")[0])
    return found - sys.stdlib_module_names


def product_imports(package: str) -> set[str]:
    folder = WORKSPACE / "src" / package
    return imports_of([*(folder / package).rglob("*.py"), *folder.glob("launch/*.py")]) - {package}


def check_imports(package: str) -> set[str]:
    """What the tests of a package import, without the modules beside them and without the package itself."""
    files = list((WORKSPACE / "src" / package / "test").rglob("*.py"))
    shared = {path.stem for path in WORKSPACE.glob("src/*/test/**/*.py")}
    return imports_of(files) - shared - {package}


def message_packages(package: str) -> set[str]:
    """Packages of the messages on the topics that a package's nodes publish or read."""
    graph = yaml.safe_load((WORKSPACE / "config/graph.yaml").read_text(encoding="utf-8"))
    nodes = {name for name, node in graph["nodes"].items() if node["package"] == package}
    return {
        topic["type"].partition("/")[0]
        for topic in graph["topics"].values()
        if nodes & {*topic["from"], *topic["to"]}
    }  # fmt: skip


def dependency(module: str) -> str:
    return ROSDEP_KEYS.get(module, module)


def declared(package: str, *tags: str) -> set[str]:
    root = ET.parse(WORKSPACE / "src" / package / "package.xml").getroot()
    return {element.text or "" for tag in tags for element in root.findall(tag)}


def listed(name: str) -> set[str]:
    lines = (WORKSPACE / "requirements" / f"{name}.in").read_text(encoding="utf-8").splitlines()
    return {line for line in lines if line and not line.startswith("#")}


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_declares_what_the_package_imports_and_nothing_else(package):
    needed = {dependency(module) for module in product_imports(package) - PYPI_ONLY.keys()} | message_packages(package)
    if package == "feedopt_core":
        # Its files are found by name, not imported; every other package finds them through the core.
        needed.add("feedopt_config")
    assert declared(package, "depend", "exec_depend") == needed


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_declares_what_the_tests_import_on_top_and_nothing_else(package):
    product = declared(package, "depend", "exec_depend")
    needed = {dependency(module) for module in check_imports(package) - PYPI_ONLY.keys()}
    assert declared(package, "test_depend") == needed - product


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_names_what_rosdep_does_not_know(package):
    text = (WORKSPACE / "src" / package / "package.xml").read_text(encoding="utf-8")
    named = {name.strip() for match in PYPI_COMMENT.finditer(text) for name in match[1].split(",")}
    assert named == {PYPI_ONLY[module] for module in product_imports(package) & PYPI_ONLY.keys()}


def test_messages_declare_what_they_find_and_refer_to():
    folder = WORKSPACE / "src/feedopt_msgs"
    found = set(re.findall(r"find_package\((\w+)", (folder / "CMakeLists.txt").read_text(encoding="utf-8")))
    fields = "\n".join(path.read_text(encoding="utf-8") for path in [*folder.glob("msg/*"), *folder.glob("action/*")])
    found |= set(re.findall(r"^(\w+)/\w+(?:\[\d*\])? \w", fields, re.MULTILINE))
    # The generator makes the goal and status messages of an action from these.
    found.add("action_msgs")
    assert declared("feedopt_msgs", "depend", "buildtool_depend") == found


def test_requirements_hold_what_the_packages_import():
    pypi = {package: product_imports(package) for package in PACKAGES}
    for package, modules in pypi.items():
        names = {ON_PYPI.get(module, module) for module in modules if module in ROSDEP_KEYS.keys() | PYPI_ONLY.keys()}
        assert names <= listed("run") | listed("view"), package
        if package != "feedopt_tools":
            assert names <= listed("run"), package
    imported = {ON_PYPI.get(module, module) for modules in pypi.values() for module in modules}
    assert listed("run") | listed("view") <= imported


def test_readme_names_the_packages_without_a_rosdep_key():
    sentence = re.search(r"([^;]*) have no\s+rosdep key", (WORKSPACE / "README.md").read_text(encoding="utf-8"))
    assert sentence is not None
    assert set(re.findall(r"`([a-z0-9-]+)`", sentence[1])) == set(PYPI_ONLY.values())
