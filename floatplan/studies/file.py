"""Study files: TOML in; a base problem, the numbers of it that vary, and how to plan all of them."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arguments import without
from floatplan.arrays import Array
from floatplan.errors import PACKAGE, InputError, naming, refuse
from floatplan.files import json_value, read_regular, runs_folder
from floatplan.kernel.library import description
from floatplan.keys import read_tables
from floatplan.plans.reading import robot_record
from floatplan.problem.family import Family
from floatplan.problem.file import LARGEST_PROBLEM, load_problem, read_toml
from floatplan.problem.problem import Problem
from floatplan.studies import schema
from floatplan.tables import ROBOT_KINDS

MOST_ROWS = 1_000_000  # [-] of a study
LARGER_IS_BETTER = ("clearance",)  # columns of a map
OF_JUMPS = {"height": "m", "jump_duration": "s", "friction_used": ""}  # columns that only jumps have, and their units

Values: TypeAlias = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Axis:
    """A number that varies: the values of a grid, or the ends of its range, in the file's unit."""

    path: str
    number: schema.VariedNumber
    values: Array

    def column(self, values: Array) -> npt.NDArray[Any]:
        """Values as the table has them, and the problem takes them."""
        return values.astype(np.int64) if self.number.whole else values


@dataclass(frozen=True, eq=False)
class Samples:
    """The rows: those of a grid in the order of its keys, the last one fastest.

    A random row is the same whatever their number is.
    """

    axes: Sequence[Axis]
    kind: schema.Kind
    count: int
    seed: int

    def values(self, first: int, stop: int) -> Values:
        """Values (stop - first,) of the rows from ``first`` on, by path, in the file's units."""
        values = {}
        if self.kind == "grid":
            indices = np.unravel_index(np.arange(first, stop), [len(axis.values) for axis in self.axes])
            for axis, index in zip(self.axes, indices, strict=True):
                values[axis.path] = axis.column(axis.values[index])
            return values
        for axis, shares in zip(self.axes, self._shares[first:stop].T, strict=True):
            low = axis.values[0]
            high = axis.values[-1]
            values[axis.path] = axis.column(low + (high - low) * shares)
        return values

    @cached_property
    def _shares(self) -> Array:
        """Shares (count, axes) of the ranges, from 0 to 1."""
        if self.kind == "random":
            return np.random.default_rng(self.seed).random((self.count, len(self.axes)))
        from scipy.stats import qmc  # slow to load

        sequence = qmc.Sobol(len(self.axes), scramble=True, rng=np.random.default_rng(self.seed))
        return np.asarray(sequence.random_base2(math.ceil(math.log2(self.count)))[: self.count])


@dataclass(frozen=True, eq=False)
class StudyFile:
    """A study as its file describes it.

    Attributes
    ----------
    name : of the file
    base : the problem whose numbers vary
    problem_file : content of its file
    samples : the rows
    plan : how hard to try
    folder : where results go, from the working directory
    map : horizontal key, vertical key, colour; None where there is none
    """

    name: str
    base: Problem
    problem_file: bytes
    samples: Samples
    plan: schema.PlanTable
    folder: Path
    map: tuple[str, str, str] | None

    def __len__(self) -> int:
        return self.samples.count

    @property
    def paths(self) -> list[str]:
        """Keys that vary."""
        return [axis.path for axis in self.samples.axes]

    @property
    def units(self) -> dict[str, str]:
        """Unit of each key in the table, as the file has it."""
        return {axis.path: axis.number.unit for axis in self.samples.axes}

    def problems(self, values: Values) -> Family:
        """Problems with values in the file's units."""
        in_si = {}
        for axis in self.samples.axes:
            factor = axis.number.factor
            in_si[axis.path] = values[axis.path] if factor == 1 else factor * values[axis.path]
        return Family(self.base, in_si)

    def family(self, first: int, stop: int) -> Family:
        """Problems of some rows."""
        return self.problems(self.samples.values(first, stop))

    def digest(self) -> str:
        """Hash of all that the rows' results follow from: problem file, robot, sampling, effort, version and solver."""
        robot = robot_record(self.base.robot).to_dict()
        content = {
            "versions": versions(),
            "problem": self.problem_file.decode("utf-8", "replace"),
            "robot": without(robot, ROBOT_KINDS),
            "vary": [[axis.path, axis.values] for axis in self.samples.axes],
            "sampling": [self.samples.kind, self.samples.count, self.samples.seed],
            "plan": asdict(self.plan),
        }
        return hashlib.sha256(json.dumps(json_value(content), sort_keys=True).encode()).hexdigest()


@cache
def versions() -> Mapping[str, str]:
    """Versions on which results depend; all machines of a study must have the same.

    The code is that of the package as it is here, changed or not: its modules and the compiled kernel.
    """
    digest = hashlib.sha256()
    for path in sorted([*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.so")]):
        digest.update(f"{path.relative_to(PACKAGE).as_posix()} ".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    code = digest.hexdigest()[:16]
    solver = description().partition(" (")[0]
    return {"floatplan": version("floatplan"), "code": code, "solver": solver}


def load_study_file(path: str | Path) -> StudyFile:
    """Read a study file, and the problem that it names.

    Raises
    ------
    InputError
        The file, its problem or the robot cannot be read; or keys are unknown, missing or wrong: all in one message.
    """
    path = Path(path)
    with naming(path):
        tables = read_tables(schema.StudyTables, schema.with_sampling(read_toml(path, "a study file")))
    if tables.plan.jump and tables.plan.search:
        raise InputError("is for flights alone", source=path, element="plan.search", advice="raise plan.starts")
    problem = path.parent / tables.problem
    base = load_problem(problem)
    if tables.plan.jump and base.jump is None:
        advice = f"add a table [jump] to {problem.name}, or leave it out"
        raise InputError("is for problems of whole jumps", source=path, element="plan.jump", advice=advice)
    if base.robot.base == "free-flyer" and not tables.plan.jump:
        advice = "set it to true, for whole jumps" if base.jump else "study a flight in a plane"
        reason = "in space studies are of whole jumps, not yet of flights"
        raise InputError(reason, source=path, element="plan.jump", advice=advice)
    content = read_regular(problem, LARGEST_PROBLEM, "a problem file")
    with naming(path):
        samples = _samples(tables, base, degrees=read_toml(problem).get("angles") == "deg")
        folder = Path(tables.result.folder) if tables.result.folder else runs_folder(path.stem, "study")
        return StudyFile(path.stem, base, content, samples, tables.plan, folder, _map(tables, base))


def _samples(tables: schema.StudyTables, base: Problem, degrees: bool) -> Samples:
    if not tables.vary:
        raise InputError("varies nothing", element="vary", advice='give a path such as "flight.duration"')
    most = 32  # [-] numbers of a problem that a study varies
    if len(tables.vary) > most:
        raise InputError(f"{len(tables.vary)} keys, more than {most}", element="vary")
    count = _count(tables)
    errors: list[InputError] = []
    axes: list[Axis] = []
    for path, varied in tables.vary.items():
        try:
            axes.append(_axis(path, varied, tables.sampling, degrees))
            Family(base, {path: axes[-1].column(axes[-1].values[:1])})
        except InputError as error:
            errors.append(error if (error.element or "").startswith("vary.") else error.within(element="vary"))
    refuse(errors)
    return Samples(axes, tables.sampling, count, tables.seed)


def _count(tables: schema.StudyTables) -> int:
    """Number of rows."""
    if tables.sampling == "grid":
        if tables.samples is not None:
            raise InputError("is not for a grid", element="samples", advice='set sampling = "sobol" or "random"')
        count = 1
        for varied in tables.vary.values():
            length = varied.count if isinstance(varied, schema.RangeTable) else len(varied)
            count *= length or 1
    elif tables.samples is None:
        raise InputError("is missing", element="samples", advice="give the number of rows to draw")
    else:
        count = tables.samples
    if count > MOST_ROWS:
        raise InputError(f"{count} rows, more than {MOST_ROWS}", element="vary", advice="vary less, or more coarsely")
    return count


def _axis(path: str, varied: Any, sampling: str, degrees: bool) -> Axis:
    number = schema.varied_number(path, degrees)
    element = f"vary.{path}"
    if isinstance(varied, schema.RangeTable):
        if varied.from_ > varied.to:
            raise InputError(f"from {varied.from_:g} is above to {varied.to:g}", element=element)
        if sampling == "grid" and varied.count is None:
            raise InputError("is missing", element=f"{element}.count", advice="give the number of values of a grid")
        if sampling != "grid" and varied.count is not None:
            raise InputError(f"is for a grid, not for sampling = {sampling!r}", element=f"{element}.count")
        values = np.linspace(varied.from_, varied.to, varied.count or 2)
    elif sampling != "grid" or not varied:
        raise InputError("must be a table with from and to" if varied else "is an empty list", element=element)
    else:
        values = np.array(varied)
    if number.whole and sampling != "grid":
        raise InputError("is a whole number, which is not drawn", element=element, advice='use sampling = "grid"')
    for value in values if number.whole else (values.min(), values.max()):
        number.check(float(value), element)
    return Axis(path, number, values)


def _map(tables: schema.StudyTables, base: Problem) -> tuple[str, str, str] | None:
    keys = list(tables.vary)
    if tables.result.map is None:
        return (keys[0], keys[1], "torque_peak") if len(keys) > 1 else None
    check_map(tables.result.map, keys, coloured(base, tables.plan), "result.map")
    return tables.result.map


def check_map(names: tuple[str, str, str], keys: Sequence[str], columns: Sequence[str], element: str) -> None:
    """Refuse a map whose axes are not two keys that vary, or whose colour is no column of numbers."""
    x, y, z = names
    for key in (x, y):
        if key not in keys:
            raise InputError(f"{key!r} does not vary", element=element, advice=f"known: {', '.join(keys)}")
    if x == y:
        raise InputError("both axes are the same key", element=element, advice="give two that vary")
    if z not in keys and z not in columns:
        names_of_columns = ", ".join([*keys, *columns])
        raise InputError(f"{z!r} is no column of numbers", element=element, advice=f"known: {names_of_columns}")


def coloured(base: Problem, plan: schema.PlanTable) -> list[str]:
    """Columns of numbers that a map can show."""
    torques = ["torque_peak"]
    torques += [f"torque_peak.{motor}" for motor in base.robot.motors]
    measured = ["utilisation", "clearance"]
    if plan.jump:
        measured += OF_JUMPS
    return ["objective", "angular_momentum", *torques, *measured, "starts", "milliseconds"]
