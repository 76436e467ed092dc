"""The stub file names what the extension has, and each name has its description."""

import ast
import inspect
import pathlib

import plumbline
from plumbline import _plumbline

stub = ast.parse((pathlib.Path(plumbline.__file__).parent / "_plumbline.pyi").read_text())


def public(names):
    return {name for name in names if not name.startswith("__")}


def own(kind):
    return public(kind.__dict__)


classes = {node.name: node for node in stub.body if isinstance(node, ast.ClassDef)}
functions = {node.name: node for node in stub.body if isinstance(node, ast.FunctionDef)}
found = public(dir(_plumbline))
assert found == classes.keys() | functions.keys(), found ^ (classes.keys() | functions.keys())
for name, node in classes.items():
    stubbed = public(it.name for it in node.body if isinstance(it, ast.FunctionDef))
    assert own(getattr(_plumbline, name)) == stubbed, (name, own(getattr(_plumbline, name)) ^ stubbed)
for name, node in functions.items():
    rest = [node.args.kwarg] if node.args.kwarg else []
    arguments = [it.arg for it in node.args.args + node.args.kwonlyargs + rest]
    assert list(inspect.signature(getattr(_plumbline, name)).parameters) == arguments, name

assert (pathlib.Path(plumbline.__file__).parent / "py.typed").exists()
for name in plumbline.__all__:
    assert name == "__version__" or inspect.getdoc(getattr(plumbline, name)), name
for kind in (plumbline.Trial, plumbline.Table, *(getattr(_plumbline, name) for name in classes)):
    for name in own(kind):
        assert inspect.getdoc(getattr(kind, name)), (kind, name)
