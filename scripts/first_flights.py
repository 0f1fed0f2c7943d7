"""Prints a table of what ``floatplan init`` finds for much-used robots. Names choose some of them.

Each file is written, read again and planned as it stands: the table says whether that is proved, and without warnings.
Under it stands why some are no more than they are.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path

import floatplan as fp
from floatplan.initial.flight import first_flight
from floatplan.initial.robots import chosen_robot
from floatplan.initial.text import problem_file_text
from floatplan.robot.urdf.tree import PREFIX

ROOT = Path(__file__).resolve().parents[1]
ROBOTS = {
    "gymnast": str(ROOT / "urdf" / "gymnast.urdf"),
    "acrobat": str(ROOT / "urdf" / "acrobat.urdf"),
    "chain10": str(ROOT / "urdf" / "chain10.urdf"),
    "high_jumper": str(ROOT / "urdf" / "high_jumper.urdf"),
    **{
        Path(urdf).stem: PREFIX + urdf
        for urdf in (
            "go2_description/urdf/go2.urdf",
            "a1_description/urdf/a1.urdf",
            "solo_description/robots/solo12.urdf",
            "g1_description/urdf/g1_29dof_rev_1_0.urdf",
            "talos_data/robots/talos_reduced.urdf",
            "go1_description/urdf/go1.urdf",
            "b1_description/urdf/b1.urdf",
            "anymal_c_simple_description/urdf/anymal.urdf",
            "laikago_description/urdf/laikago.urdf",
            "hyq_description/robots/hyq_no_sensors.urdf",
            "solo_description/robots/solo.urdf",
            "bolt_description/robots/bolt.urdf",
            "human_description/robots/human.urdf",
            "icub_description/robots/icub.urdf",
            "romeo_description/urdf/romeo.urdf",
            "simple_humanoid_description/urdf/simple_humanoid.urdf",
            "panda_description/urdf/panda.urdf",
            "ur_description/urdf/ur5_robot.urdf",
            "ur_description/urdf/ur10_robot.urdf",
            "kinova_description/robots/kinova.urdf",
            "tiago_description/robots/tiago.urdf",
        )
    },
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=list(ROBOTS))
    print("| robot | turn, degrees | jump | torque / limit | rate / limit | flight, s | proof | warnings | CPU, s |")
    print("|---|---:|---|---:|---:|---:|---|---:|---:|")
    told: list[str] = []
    for name in parser.parse_args().names:
        print(row(name, told), flush=True)
    print(*told, sep="\n")


def row(name: str, told: list[str]) -> str:
    """One robot's cells; why it is no more than it is, is added to what is told."""
    began = time.process_time()
    try:
        chosen = chosen_robot(ROBOTS[name])
        flight = first_flight(chosen)
    except fp.FloatplanError as error:
        return f"| {name} | {error} | ({time.process_time() - began:.1f} s)"
    seconds = time.process_time() - began
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.toml"
        path.write_text(problem_file_text(chosen, flight, path), encoding="utf-8")
        plan = fp.plan(fp.load_problem(path), prove=True)
    told += [f"{name}: {reason}" for reason in flight.reasons]
    figures = {} if flight.jump is None else flight.jump.check.figures
    cells = [
        name,
        f"{math.degrees(flight.turn):.0f}",
        "afloat" if flight.jump is None else "stances checked" if flight.jump.ok else "not within limits",
        *(f"{figures[name]:.2f}" if name in figures else "" for name in ("torque", "velocity")),
        f"{plan.duration:g}",
        plan.status if plan.certificate is None else plan.certificate.verdict,
        str(len(plan.warnings)),
        f"{seconds:.1f}",
    ]
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
