"""The command that tells what a robot is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from floatplan.cli.bundled import argument
from floatplan.cli.common import Degrees, Json, RobotChoices, print_json, reporting_errors, with_options

LISTED = "-"  # stands for no file
ROBOTS = (".urdf", ".xml", ".toml")


class InfoCommand(TyperCommand):
    """``--shapes`` lists, ``--shapes FILE.png`` draws."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Give ``--shapes`` its value where the next word is none."""
        words: list[str] = []
        for index, word in enumerate(args):
            words.append(word)
            following = args[index + 1] if index + 1 < len(args) else LISTED
            if word == "--shapes" and (following.startswith("-") or Path(following).suffix.lower() in ROBOTS):
                words.append(LISTED)
        return super().parse_args(ctx, words)


@reporting_errors
@with_options
def info(
    source: Annotated[str, argument("ROBOT.urdf|FILE.toml", "A robot, a problem, or a file with [robot] alone.")],
    choices: RobotChoices,
    degrees: Degrees = False,
    frames: Annotated[bool, typer.Option("--frames", help="List the frames that may take off and land.")] = False,
    shapes: Annotated[
        str | None,
        typer.Option(metavar="[FILE.png]", help="List the links' capsules; or draw them over their geometry."),
    ] = None,
    json_output: Json = False,
) -> None:
    """Tell what a robot is: plane, joints, limits, inertia, shapes, and how far it leaves its plane."""
    from floatplan.cli.asked import named_robot
    from floatplan.cli.facts import robot_facts

    robot = named_robot(source, choices, degrees)
    facts = robot_facts(robot)
    if shapes is not None and shapes != LISTED:
        from floatplan.view.figures.robot_pictures import check_picture, save_shapes

        save_shapes(robot, check_picture(Path(shapes)))
    if json_output:
        print_json(facts)
        return
    from floatplan.cli.summary import facts_summary, print_summary

    print_summary(facts_summary(facts, frames=frames, shapes=shapes == LISTED))
