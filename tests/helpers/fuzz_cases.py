"""Cases of the fuzzer: what is spoiled, and the command that meets it, by the seed alone."""

import random
import shutil
from dataclasses import dataclass
from pathlib import Path

from fuzz_meshes import prepare_robot
from fuzz_mutations import spoiled
from fuzz_options import prepare_options
from fuzz_sources import FORMATS, PROBLEMS, has_gallery, plan_of, robot_of
from places import ROOT

WEIGHTS = {".toml": 8, ".urdf": 8, ".json": 8, "options": 4, "meshes": 4}


@dataclass(frozen=True)
class Case:
    """A spoiled file or command line by its seed."""

    seed: int

    @property
    def kind(self) -> str:
        """What is spoiled: a file by its suffix, the options, or a robot of the gallery with its meshes."""
        rng = random.Random(f"kind {self.seed}")
        kinds = [kind for kind in WEIGHTS if kind != "meshes" or has_gallery()]
        return rng.choices(kinds, [WEIGHTS[kind] for kind in kinds])[0]

    def prepare(self, folder: Path) -> list[str]:
        """Write the files of the case, and return the arguments of its command, to be run in the folder."""
        rng, kind = random.Random(self.seed), self.kind
        if kind == "options":
            return prepare_options(rng, folder)
        if kind == "meshes":
            return prepare_robot(rng, folder)
        name = rng.choice(PROBLEMS)
        robots = folder / "urdf"
        shutil.copytree(ROOT / "urdf", robots)
        problem, plan = folder / "problems" / f"{name}.toml", folder / "plan.json"
        problem.parent.mkdir()
        shutil.copy(ROOT / "problems" / problem.name, problem)
        if kind == ".toml":
            problem.write_bytes(spoiled(rng, problem))
        elif kind == ".urdf":
            urdf = robots / robot_of(name)
            urdf.write_bytes(spoiled(rng, urdf))
            if rng.random() < 0.3:
                return ["info", str(urdf), *rng.choice(([], ["--json"], ["--coupled", "mirror"]))]
        else:
            shutil.copy(plan_of(name), plan)
            plan.write_bytes(spoiled(rng, plan))
            return _with_plan(rng, plan, folder)
        return _with_problem(rng, problem, folder)


def _with_problem(rng: random.Random, problem: Path, folder: Path) -> list[str]:
    command = rng.choice(("plan", "plan", "info", "bounds", "takeoff"))
    arguments = [command, str(problem)]
    if command == "plan":
        arguments += ["--budget", "1", "-o", str(folder / "out")]
        arguments += rng.choice(
            (["--no-figures"], ["--json"], ["--json", "--report"], ["--no-figures", "--starts", "3"])
        )
    elif rng.random() < 0.5:
        arguments.append("--json")
    return arguments


def _with_plan(rng: random.Random, plan: Path, folder: Path) -> list[str]:
    command = rng.choice(("certify", "replay", "show", "export"))
    arguments = [command, str(plan)]
    if command == "export":
        arguments += ["-f", rng.choice(FORMATS), "-o", str(folder / "exported")]
    elif command == "show":
        arguments += ["-o", str(folder / "out")]
    elif command == "replay" and rng.random() < 0.4:
        arguments += rng.choice((["--replan", "50", "--flights", "1", "--budget", "2"], ["--authority", "--json"]))
    else:
        arguments += rng.choice(([], ["--json"], ["--save"]))
    return arguments
