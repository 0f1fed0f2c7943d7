"""What a reader of the package holds in her head, counted: figures that may fall, and rise where someone decides it.

``pytest -rP tests/test_house.py`` shows today's. Who brings one down writes the lower limit into the table.
"""

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from places import ROOT

import floatplan

PACKAGE = Path(floatplan.__file__).parent

LIMITS = {  # measure: (limit, goal)
    "statements": (46_284, 26_500),
    "statements of the largest file": (404, 405),
    "packs `a, b = x, y` per 1000 lines": (0.95, 4),
    "comprehensions per 1000 lines": (24.4, 25),
    "module constants": (584, 600),
    "private words": (1_142, 2_514),
    "lines that ask in_plane or in_space": (68, 70),
    "lines of the longest function": (80, 80),
    "parameters of a call": (9, 9),  # of a public one, whose options are keywords
    "files of a folder": (20, 20),
    "files directly in the package": (8, 8),
    "imports that walls let through": (2, 2),  # `ignore_imports` of import-linter's contracts
}
WAYS = {  # problem: limits and goals of functions and files of the package that fp.plan calls, in a fresh process
    "somersault.toml": ((62, 65), (19, 20)),
    "obstacle.toml": ((100, 100), (24, 24)),
    "space/go2_barrel_roll.toml": ((139, 140), (28, 28)),
}

# Participles and names of this project alone, where the field has a noun. "each" counts where it is a variable.
PRIVATE_WORDS = """
alone answer asked attempt began beside drawn draws eased ended exchange flown followed found given held kept known law
missed outcome part place plain pull reached ready relief rest room said swing together told turn wanted watched
"""
LETTERS = re.compile("[a-z]+")
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")
ASKS_KIND = re.compile(r"\bin_(plane|space)\b")
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
COUNTED = (ast.stmt, ast.expr, ast.comprehension, ast.ExceptHandler, ast.arguments, ast.arg, ast.keyword, ast.alias)
COUNTED += (ast.withitem, ast.match_case)
WITHOUT_NODES = {ast.Name, ast.Constant, ast.alias, ast.Pass, ast.Break, ast.Continue}
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)


@dataclass(frozen=True)
class Module:
    """One module of the package, read and parsed once."""

    path: Path
    text: str

    @cached_property
    def nodes(self):
        """What ``ast.walk`` returns, in a quarter of its time: but for contexts and operators, which nobody counts."""
        found = [self.tree]
        for node in found:  # which becomes longer meanwhile
            if type(node) in WITHOUT_NODES:
                continue
            for name in node._fields:
                value = getattr(node, name)
                if type(value) is list:
                    found += [item for item in value if isinstance(item, COUNTED)]
                elif isinstance(value, COUNTED):
                    found.append(value)
        return found

    @cached_property
    def tree(self):
        return ast.parse(self.text)

    @cached_property
    def counts(self):
        """How many nodes there are of each class."""
        return Counter(map(type, self.nodes))

    @property
    def statements(self):
        return sum(count for kind, count in self.counts.items() if issubclass(kind, ast.stmt))

    @property
    def packs(self):
        """Assignments `a, b = x, y`: several written as one."""
        assignments = [node for node in self.nodes if isinstance(node, ast.Assign)]
        return sum(isinstance(node.value, ast.Tuple) and isinstance(node.targets[0], ast.Tuple) for node in assignments)

    @property
    def comprehensions(self):
        return sum(self.counts[kind] for kind in COMPREHENSIONS)

    @property
    def constants(self):
        count = 0
        for statement in self.tree.body:
            if isinstance(statement, ast.Assign):
                targets = statement.targets
            elif isinstance(statement, ast.AnnAssign):
                targets = [statement.target]
            else:
                continue
            names = [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]
            count += sum(CONSTANT.fullmatch(name) is not None for name in names)
        return count

    @property
    def private_words(self):
        """In names and in prose; of names with underscores, every part."""
        variables = sum(type(node) is ast.Name and node.id == "each" for node in self.nodes)
        words = Counter(LETTERS.findall(self.text.lower()))
        return variables + sum(words[word] for word in PRIVATE_WORDS.split())

    @property
    def asks_kind(self):
        lines = [line for line in self.text.splitlines() if ASKS_KIND.search(line)]
        return sum("import" not in line for line in lines)

    @cached_property
    def functions(self):
        return [node for node in self.nodes if isinstance(node, FUNCTIONS)]

    def longest_function(self):
        return max(((length(node), self.name_of(node)) for node in self.functions), default=(0, ""))

    def most_parameters(self):
        """Of all functions but commands of the command line, whose parameters are its options."""
        command = "Annotated[" if self.path.parent.name == "cli" else None
        functions = [node for node in self.functions if command is None or command not in ast.unparse(node.args)]
        return max(((parameters(node), self.name_of(node)) for node in functions), default=(0, ""))

    def name_of(self, node):
        return f"{self.path.relative_to(PACKAGE)}: {node.name}"


def length(function):
    assert function.end_lineno is not None
    return function.end_lineno - function.lineno + 1


def parameters(function):
    arguments = function.args
    names = [argument.arg for argument in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def ignored_imports():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    return sum(len(contract.get("ignore_imports", [])) for contract in contracts)


def test_no_measure_of_the_house_grows():
    paths = [path for path in PACKAGE.rglob("*.py") if path.name != "_declarations.py"]
    modules = [Module(path, path.read_text(encoding="utf-8")) for path in paths]
    lines = sum(module.text.count("\n") for module in modules)
    folders = Counter(module.path.parent for module in modules)
    largest, largest_name = max((module.statements, module.path.name) for module in modules)
    longest, longest_name = max(module.longest_function() for module in modules)
    parameter_count, call = max(module.most_parameters() for module in modules)
    folder, folder_files = folders.most_common(1)[0]
    values = {
        "statements": sum(module.statements for module in modules),
        "statements of the largest file": largest,
        "packs `a, b = x, y` per 1000 lines": 1000 * sum(module.packs for module in modules) / lines,
        "comprehensions per 1000 lines": 1000 * sum(module.comprehensions for module in modules) / lines,
        "module constants": sum(module.constants for module in modules),
        "private words": sum(module.private_words for module in modules),
        "lines that ask in_plane or in_space": sum(module.asks_kind for module in modules),
        "lines of the longest function": longest,
        "parameters of a call": parameter_count,
        "files of a folder": folder_files,
        "files directly in the package": folders[PACKAGE],
        "imports that walls let through": ignored_imports(),
    }
    where = {
        "statements of the largest file": largest_name,
        "lines of the longest function": longest_name,
        "parameters of a call": call,
        "files of a folder": folder.name,
    }
    report(values, LIMITS, where)


def test_the_way_from_plan_to_a_plan_grows_no_longer():
    command = [sys.executable, ROOT / "tests" / "helpers" / "way_of_a_plan.py", *WAYS]
    finished = subprocess.run(command, cwd=ROOT / "problems", stdout=subprocess.PIPE, text=True, check=True)
    counts = json.loads(finished.stdout)
    values = {}
    limits = {}
    for name, (of_functions, of_files) in WAYS.items():
        limits[f"functions to a plan of {name}"] = of_functions
        limits[f"files to a plan of {name}"] = of_files
        values[f"functions to a plan of {name}"], values[f"files to a plan of {name}"] = counts[name]
    report(values, limits, {})


def report(values, limits, where):
    """Print all measures, and fail with those above their limits."""
    assert values.keys() == limits.keys()
    grown = []
    for measure, value in values.items():
        limit, goal = limits[measure]
        line = f"{measure}: {value:.6g}, limit {limit:g}, goal {goal:g} {where.get(measure, '')}".rstrip()
        print(line)
        if value > limit:
            grown.append(line)
    assert not grown, "\n".join(["what grew:", *grown])
