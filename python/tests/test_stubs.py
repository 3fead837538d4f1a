"""The stubs state what the module has, and everything is documented."""

import ast
import inspect
from importlib.resources import files

import palpate
from conftest import ROOT

STUBS = ast.parse((ROOT / "python" / "palpate.pyi").read_text())
CLASSES = {node.name: node for node in STUBS.body if isinstance(node, ast.ClassDef)}
FUNCTIONS = {node.name: node for node in STUBS.body if isinstance(node, ast.FunctionDef)}


def names(arguments):
    starred = [arguments.vararg] if arguments.vararg else []
    return [argument.arg for argument in arguments.posonlyargs + arguments.args + starred + arguments.kwonlyargs]


def test_the_module_has_what_the_stubs_state_and_no_more():
    public = {name for name in vars(palpate) if not name.startswith("_")} - {"palpate"}
    assert public == set(CLASSES) | set(FUNCTIONS)
    for name, stub in FUNCTIONS.items():
        signature = inspect.signature(getattr(palpate, name))
        assert list(signature.parameters) == names(stub.args), name
        kinds = {argument.arg for argument in stub.args.kwonlyargs}
        assert {p.name for p in signature.parameters.values() if p.kind is p.KEYWORD_ONLY} == kinds, name


def test_the_classes_have_what_the_stubs_state_and_no_more():
    for name, stub in CLASSES.items():
        stated = {node.name for node in stub.body if isinstance(node, ast.FunctionDef)}
        there = {member for member in vars(getattr(palpate, name)) if not member.startswith("_")}
        assert there - {"code"} == {member for member in stated if not member.startswith("_")}, name


def test_everything_is_documented():
    for name in CLASSES | FUNCTIONS:
        assert getattr(palpate, name).__doc__, name
    for name in CLASSES:
        for member, value in vars(getattr(palpate, name)).items():
            assert member.startswith("_") or member == "code" or value.__doc__, f"{name}.{member}"


def test_the_wheel_has_the_stubs():
    package = files("palpate")
    assert (package / "py.typed").is_file() and (package / "__init__.pyi").is_file()
