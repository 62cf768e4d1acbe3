"""Every kernel is called by a test of its own, beside what its renderer's tests say of it; none takes too much."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import ibrpipe.core

CORE = Path(ibrpipe.core.__file__).parent
#: decorators of what Python calls; the others are for what kernels call
KERNELS = {"kernel", "exact_kernel", "serial", "exact_serial"}
MOST_ARGUMENTS = 12


def functions() -> Iterator[tuple[Path, ast.FunctionDef, set[str]]]:
    """File, function and names of its decorators, of all below core/."""
    for path in sorted(CORE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                yield path, node, {each.id for each in node.decorator_list if isinstance(each, ast.Name)}


def called_in(path: Path) -> set[tuple[str, str]]:
    """(module, function) of core/ that a test file calls, by the function's name or by the module's."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    origin: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("ibrpipe.core"):
            for alias in node.names:
                origin[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        if isinstance(node.func, ast.Name) and node.func.id in origin:
            module, _, name = origin[node.func.id].rpartition(".")
            found.add((module, name))
        elif isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
            found.add((origin.get(node.func.value.id, ""), node.func.attr))
    return found


def test_every_kernel_is_called_by_a_test_of_core() -> None:
    called: set[tuple[str, str]] = set()
    for path in Path(__file__).parent.rglob("test_*.py"):
        called |= called_in(path)
    kernels = {
        (".".join(("ibrpipe.core", *path.relative_to(CORE).with_suffix("").parts)), node.name)
        for path, node, decorators in functions()
        if decorators & KERNELS
    }
    assert len(kernels) > 80
    assert sorted(kernels - called) == []


def test_no_kernel_takes_more_than_twelve_arguments() -> None:
    decorators_of_jit = {
        node.name for path, node, _ in functions() if path.name == "jit.py" and not node.name.startswith("_")
    }
    counts = [(len(node.args.args), node.name) for _, node, names in functions() if names & decorators_of_jit]
    assert len(counts) > 250
    assert [each for each in counts if each[0] > MOST_ARGUMENTS] == []
