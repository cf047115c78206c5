# SPDX-License-Identifier: BSD-3-Clause
"""The imports of the package experiments, as its sources state them."""
import ast
import graphlib

import pytest

from conftest import REPOSITORY

PACKAGE = "experiments"
# Debian's python3-matplotlib installs both.
THIRD_PARTY = {"matplotlib", "numpy"}


def modules_of(root):
    """{module name: path} of all modules of the package below `root`."""
    return {".".join(path.relative_to(root).with_suffix("").parts): path
            for path in sorted((root / PACKAGE).rglob("*.py"))}


def imported_names(path):
    """The dotted names that a file imports anywhere, in functions, too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def import_graph(root):
    """{module: modules of the package that it imports}."""
    modules = modules_of(root)
    packages = {name.removesuffix(".__init__"): name for name in modules}

    def module_of(name):
        # The longest prefix that is a module; the rest is a name within it.
        while name and name not in packages:
            name = name.rpartition(".")[0]
        return packages.get(name)
    return {name: {module_of(imported) for imported in imported_names(path)}
            - {None} for name, path in modules.items()}


def test_no_cycles():
    graph = import_graph(REPOSITORY)
    assert len(graph) > 20
    order = list(graphlib.TopologicalSorter(graph).static_order())
    assert sorted(order) == sorted(graph)


def test_layers_of_the_readme():
    row = {module: k for k, modules in enumerate(readme_rows())
           for module in modules}
    top = {name: row[name.split(".")[1]] for name in import_graph(REPOSITORY)
           if name.split(".")[1] not in ("__init__", "__main__")}
    for name, imported in import_graph(REPOSITORY).items():
        for other in imported:
            if name in top and other in top:
                assert top[name] <= top[other], f"{name} imports {other}"


def readme_rows():
    """The modules and packages in each row of the table in the README."""
    text = (REPOSITORY / PACKAGE / "README.md").read_text()
    table = text[text.index("| modules | content |"):].splitlines()[2:]
    rows = []
    for line in table:
        if not line.startswith("|"):
            break
        rows.append([word.strip(" `/")
                     for word in line.split("|")[1].split(",")])
    return rows


def test_a_cycle_is_found(tmp_path):
    (tmp_path / PACKAGE).mkdir()
    (tmp_path / PACKAGE / "a.py").write_text("from experiments import b\n")
    (tmp_path / PACKAGE / "b.py").write_text(
        "def late():\n    from experiments.a import name\n")
    with pytest.raises(graphlib.CycleError):
        graphlib.TopologicalSorter(import_graph(tmp_path)).prepare()


def test_only_figures_and_calibrations_need_more_than_the_standard_library():
    users = {name for name, path in modules_of(REPOSITORY).items()
             if THIRD_PARTY & {n.partition(".")[0]
                               for n in imported_names(path)}}
    allowed = ("experiments.figures.", "experiments.datasets.mei_camera",
               "experiments.datasets.kitti360_calibration")
    assert users
    assert all(name.startswith(allowed) for name in users)


def test_imports_of_third_parties_are_those_of_debian():
    import sys
    known = set(sys.stdlib_module_names) | THIRD_PARTY | {PACKAGE}
    for path in modules_of(REPOSITORY).values():
        for name in imported_names(path):
            assert name.partition(".")[0] in known, f"{path} imports {name}"


def test_functions_are_short():
    for path in modules_of(REPOSITORY).values():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                assert node.end_lineno - node.lineno < 60, (path, node.name)
                assert node.name == "__init__" or ast.get_docstring(
                    node) or node.col_offset > 0, (path, node.name)
