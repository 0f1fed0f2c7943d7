"""The command that lists robots: the project's own, and those of example-robot-data."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import typer

from floatplan.cli.bundled import found, own_urdfs
from floatplan.cli.common import Json, print_json, reporting_errors
from floatplan.cli.progress import progress

if TYPE_CHECKING:
    from floatplan.robot.robot import Robot


@reporting_errors
def robots(json_output: Json = False) -> None:
    """List the robots at hand: what to type, and the joints that turn in the plane."""
    usable: list[dict[str, Any]] = []
    unusable: list[dict[str, Any]] = []
    with progress("reading"):
        for source in _sources():
            facts = _facts(source)
            (unusable if "reason" in facts else usable).append(facts)
    if json_output:
        print_json({"robots": usable, "unusable": unusable})
        return
    for line in _lines(usable, unusable):
        typer.echo(line)


def _sources() -> Iterator[str]:
    from floatplan.robot.urdf.example_robots import PREFIX, example_urdfs

    yield from own_urdfs()
    yield from (PREFIX + name for name in example_urdfs())


def _facts(source: str) -> dict[str, Any]:
    """A robot in short, its legs coupled where it has pairs of them; or why it cannot be used as it is."""
    from floatplan.errors import InputError
    from floatplan.robot.robot import Robot

    def told(robot: Robot, coupled: str | None) -> dict[str, Any]:
        moving = {"joints": list(robot.joints), "coupled": coupled, "followers": list(robot.coupled)}
        return {"robot": source, "name": robot.name, "mass": robot.mass, "plane": robot.plane.name, **moving}

    try:
        return told(Robot.from_urdf(found(source), coupled="mirror"), "mirror")
    except InputError:
        pass
    try:
        return told(Robot.from_urdf(found(source)), None)
    except InputError as error:
        return {"robot": source, "reason": error.reason}


def _lines(usable: list[dict[str, Any]], unusable: list[dict[str, Any]]) -> Iterator[str]:
    """A line for each robot; its name comes last and whole, ready to be copied."""
    from floatplan.errors import install_advice
    from floatplan.robot.urdf.example_robots import robots_folder

    yield f"{'joints':<9}{'kg':>7}  plane  robot"
    for facts in usable:
        count = str(len(facts["joints"]))
        count += f" + {len(facts['followers'])}" if facts["followers"] else ""
        pairs = " --coupled mirror" if facts["coupled"] else ""
        yield f"{count:<9}{facts['mass']:>7.3g}  {facts['plane']:<5}  {facts['robot']}{pairs}"
    yield "Joints are those that turn in the plane + those that follow them; floatplan info ROBOT tells more."
    if unusable:
        yield f"{len(unusable)} more cannot be used as they are: --json has the reasons."
    if robots_folder() is None:
        yield f"More robots come with the extra robots; {install_advice('robots')}"
