"""Quadratic programs that searches meet, recorded while problems are planned.

    minimise  g x + x H x / 2   subject to  c + A x = 0  and  d + C x >= 0

``python benchmarks/recorded_quadratics.py`` compiles a kernel that writes them down, plans problems with it, and keeps
a sample of the programs in ``tests/kernel/recorded_quadratics.npz``.
"""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from os import environ
from pathlib import Path
from unittest.mock import patch

import numpy as np
from measuring import PROBLEMS
from reduced_program import Derivatives, Evaluation

import floatplan as fp
from floatplan.arrays import Array, IntArray
from floatplan.kernel import library
from floatplan.kernel.build import build, command
from floatplan.studies.file import load_study_file

FILE = Path(__file__).resolve().parents[1] / "tests" / "kernel" / "recorded_quadratics.npz"
PROGRAMS = 22  # [-] kept of each source, and as many of the kinds below
MOST_NUMBERS = 900  # [-] of a program that is kept: the file stays below 1 MB
SINGULAR = 1e-8  # [-] eigenvalue of a Hessian, relative to its largest: below it the Hessian is called degenerate

# What each translation unit of the recording kernel begins with: programs are written one after the other, counts as
# int64, then numbers. Rows stand as the kernel has them, in packs (size, 8) of 8 rows.
RECORDER = r"""
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#define OBSERVE_QUADRATIC(qp) write_quadratic(qp)
template <typename Program> static void write_quadratic(const Program &qp) {
    static std::FILE *file = std::fopen(std::getenv("FLOATPLAN_RECORDED"), "ab");
    const std::int64_t counts[] = {qp.size, qp.equalities, qp.rows};
    const auto write = [](const double *numbers, std::int64_t count) {
        if (count) std::fwrite(numbers, sizeof(double), count, file);
    };
    std::fwrite(counts, sizeof(counts), 1, file);
    write(qp.hessian, qp.size * qp.size);
    write(qp.gradient, qp.size);
    write(qp.equality, qp.equalities);
    write(qp.equality_rows, qp.equalities * qp.size);
    write(qp.inequality, qp.rows);
    write(qp.inequality_rows, qp.rows * qp.size);
    std::fflush(file);
}
"""


@dataclass(frozen=True, eq=False)
class RecordedQuadratic:
    """One of them.

    Attributes
    ----------
    source : str
        What was planned.
    hessian : (size, size)
        H.
    gradient : (size,)
        g.
    equality, equality_rows : (e,), (e, size)
        c and A.
    inequality, inequality_rows : (k,), (k, size)
        d and C.
    """

    source: str
    hessian: Array
    gradient: Array
    equality: Array
    equality_rows: Array
    inequality: Array
    inequality_rows: Array

    @property
    def arrays(self) -> tuple[Array, ...]:
        """Its arrays, in the order of the file."""
        return (
            self.hessian,
            self.gradient,
            self.equality,
            self.equality_rows,
            self.inequality,
            self.inequality_rows,
        )

    @property
    def numbers(self) -> int:
        """How many numbers it has."""
        return sum(array.size for array in self.arrays)

    @property
    def evaluation(self) -> Evaluation[None]:
        """As :func:`reduced_program.dual_step` takes it, beside the Hessian."""
        derivatives = Derivatives(self.gradient, self.equality_rows, self.inequality_rows)
        return Evaluation(0.0, self.equality, self.inequality, lambda: derivatives, None)

    def least_eigenvalue(self) -> float:
        """Least eigenvalue of the Hessian, relative to the largest magnitude of one."""
        eigenvalues = np.linalg.eigvalsh((self.hessian + self.hessian.T) / 2)
        return float(eigenvalues[0] / np.abs(eigenvalues).max())


def shapes(size: int, equalities: int, rows: int) -> tuple[tuple[int, ...], ...]:
    """Shapes of the arrays of a program, in the order of the file."""
    return (size, size), (size,), (equalities,), (equalities, size), (rows,), (rows, size)


def split(source: str, numbers: Array, counts: IntArray) -> RecordedQuadratic:
    """Make a program of the numbers that stand one after the other."""
    arrays, begin = list[Array](), 0
    for shape in shapes(*counts.tolist()):
        end = begin + int(np.prod(shape))
        arrays.append(numbers[begin:end].reshape(shape))
        begin = end
    return RecordedQuadratic(source, *arrays)


def recorded() -> list[RecordedQuadratic]:
    """Return the programs that are kept."""
    with np.load(FILE) as file:
        sources, counts, numbers = file["source"], file["counts"], file["numbers"]
    programs, begin = list[RecordedQuadratic](), 0
    for source, own in zip(sources.tolist(), counts, strict=True):
        end = begin + sum(int(np.prod(shape)) for shape in shapes(*own.tolist()))
        programs.append(split(source, numbers[begin:end], own))
        begin = end
    return programs


def written(source: str, path: Path) -> Iterator[RecordedQuadratic]:
    """Read what the recording kernel has written; rows that do not apply, whose values are infinite, are left out."""
    content = np.fromfile(path, np.float64)
    begin = 0
    while begin < len(content):
        size, equalities, rows = counts = content[begin : begin + 3].view(np.int64)
        begin += 3
        end = begin + sum(int(np.prod(shape)) for shape in shapes(size, equalities, rows))
        program = split(source, content[begin:end], counts)
        begin = end
        packs = program.inequality_rows.reshape(-1, size, 8)
        applies = np.isfinite(program.inequality)
        inequality_rows = packs.swapaxes(1, 2).reshape(rows, size)[applies]
        yield replace(program, inequality=program.inequality[applies], inequality_rows=inequality_rows)


def plan_files(*names: str) -> None:
    """Plan problem files."""
    for name in names:
        fp.plan(fp.load_problem(PROBLEMS / f"{name}.toml"))


def plan_study(name: str, every: int) -> None:
    """Plan rows of a study."""
    study = load_study_file(PROBLEMS / "studies" / f"{name}.toml")
    for problem in islice(study.family(0, len(study)), 0, None, every):
        fp.plan(problem)


SOURCES: dict[str, Callable[[], None]] = {
    "without limits": partial(plan_files, "new_configuration", "handstand", "somersault", "falling_cat", "backflip"),
    "obstacles": partial(
        plan_files, "obstacle", "obstacle_hard", "moving_hoop", "handstand_ground", "falling_cat_apart"
    ),
    "limited torque": partial(plan_files, "torque_limited", "somersault_low_torque", "somersault_motors"),
    "hardly possible": partial(plan_files, "torque_limited_hard"),
    "study pole": partial(plan_study, "pole", 48),
    "study weak_motors": partial(plan_study, "weak_motors", 48),
    "arms in space": partial(plan_files, "space/free_ur5", "space/free_panda"),
    "divers in space": partial(plan_files, "space/diver_full_twist", "space/diver_half_twist", "space/cat"),
}


def sample(programs: list[RecordedQuadratic], rng: np.random.Generator) -> list[RecordedQuadratic]:
    """Choose some of a source at random: of all, of those with degenerate Hessians, and of those with many rows."""
    small = [program for program in programs if program.numbers <= MOST_NUMBERS]
    kinds = (
        small,
        [program for program in small if program.least_eigenvalue() < SINGULAR],
        [program for program in small if len(program.inequality) > 2 * len(program.gradient)],
    )
    chosen = dict[int, RecordedQuadratic]()
    for kind in kinds:
        for place in rng.permutation(len(kind))[:PROGRAMS].tolist():
            chosen[id(kind[place])] = kind[place]
    return list(chosen.values())


def main() -> None:
    """Record programs of all sources, and keep a sample."""
    rng = np.random.default_rng(0)
    kept = list[RecordedQuadratic]()
    with tempfile.TemporaryDirectory() as scratch:
        header = Path(scratch, "recorder.hpp")
        header.write_text(RECORDER, encoding="utf-8")
        compiler = shlex.join([*command(), "-include", str(header)])
        with patch.dict(environ, CXX=compiler):
            build(Path(scratch))
        with patch.object(library, "FOLDER", Path(scratch)):
            for number, (source, run) in enumerate(SOURCES.items()):
                path = Path(scratch, "recorded")
                environ["FLOATPLAN_RECORDED"] = str(path)
                run()
                programs = list(written(source, path))
                path.write_bytes(b"")
                chosen = sample(programs, rng)
                degenerate = sum(program.least_eigenvalue() < SINGULAR for program in chosen)
                print(f"{number} {source}: {len(programs)} programs, {len(chosen)} kept, {degenerate} degenerate")
                kept.extend(chosen)
    np.savez_compressed(
        FILE,
        source=np.array([program.source for program in kept]),
        counts=np.array([(*program.equality_rows.T.shape, len(program.inequality)) for program in kept]),
        numbers=np.concatenate([array.ravel() for program in kept for array in program.arrays]),
    )
    print(f"{len(kept)} programs, {FILE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
