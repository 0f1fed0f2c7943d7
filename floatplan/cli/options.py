"""The options that say what is asked: each declared once, with the key of a problem file that it stands for."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, get_type_hints

import typer

from floatplan.tables import OBJECTIVE_TABLE

OBJECTIVE_HELP = "; ".join(f"{name}: {row.description}, {row.unit}" for name, row in OBJECTIVE_TABLE.items())


def _said(metavar: str, text: str, key: str = "") -> Any:
    """An option, and the key of a problem file that it stands for."""
    option = typer.Option(metavar=metavar, help=text)
    option.key = key
    return option


Degrees = Annotated[
    bool, typer.Option("--degrees/--radians", help="Unit of all angles and rates on this command line.")
]


@dataclass(frozen=True)
class RobotChoices:
    """How a URDF is to be read, as typed; None where left out."""

    plane: Annotated[str | None, _said("XZ", "The plane's axes, where the URDF leaves a choice.")] = None
    coupled: Annotated[
        str | None, _said("F=L,..", "Joints that follow others: F=L, F=-L, F=0.5*L; or 'mirror': left and right.")
    ] = None
    locked: Annotated[str | None, _said("J=A,..", "Joints that stay at an angle.")] = None
    reference: Annotated[str | None, _said("NAME", "Posture of the SRDF file beside the URDF, for other joints.")] = (
        None
    )


@dataclass(frozen=True)
class Options:
    """What is asked of a flight, as typed; None where left out."""

    start: Annotated[
        str | None, _said("O,Q1,..", "Orientation, then the joints, at takeoff: -90,0,0 or '-90 0 0'.", "start")
    ] = None
    goal: Annotated[str | None, _said("O,Q1,..", "The same at landing.", "goal")] = None
    duration: Annotated[float | None, _said("S", "Time of flight, s.", "flight.duration")] = None
    start_velocities: Annotated[str | None, _said("V1,..", "Of the joints at takeoff.", "start.velocities")] = None
    goal_velocities: Annotated[str | None, _said("V1,..", "Of the joints at landing.", "goal.velocities")] = None
    start_accelerations: Annotated[str | None, _said("A1,..", "Of the joints at takeoff.", "start.accelerations")] = (
        None
    )
    goal_accelerations: Annotated[str | None, _said("A1,..", "Of the joints at landing.", "goal.accelerations")] = None
    angular_momentum: Annotated[
        str | None, _said("H", "kg m^2/s, or 'midpoint' (the default), or 'free'.", "flight.angular_momentum")
    ] = None
    takeoff: Annotated[str | None, _said("FRAME", "Frame that leaves the ground last.", "flight.takeoff.frame")] = None
    landing: Annotated[str | None, _said("FRAME", "Frame that lands first.", "flight.landing.frame")] = None
    horizontal_velocity: Annotated[
        float | None, _said("V", "Of the centre of mass, m/s.", "flight.horizontal_velocity")
    ] = None
    degree: Annotated[
        str | None, _said("K", "Of the polynomials: one number, one per joint, or auto.", "motion.degree")
    ] = None
    objective: Annotated[
        str | None, _said("NAME", f"What is least; the first if left out. {OBJECTIVE_HELP}.", "motion.objective")
    ] = None

    @classmethod
    @functools.cache
    def keys(cls) -> dict[str, str]:
        """The key of each option, the longest first."""
        hints = get_type_hints(cls, include_extras=True)
        keys = {name: hint.__metadata__[0].key for name, hint in hints.items()}
        return dict(sorted(keys.items(), key=lambda item: -len(item[1])))


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options that its parameters which are such dataclasses declare."""
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    parameters: list[Parameter] = []
    for parameter in signature(command).parameters.values():
        group = groups.get(parameter.name)
        if group is None:
            parameters.append(parameter.replace(annotation=hints[parameter.name]))
        else:
            types = get_type_hints(group, include_extras=True)
            parameters += [
                Parameter(each.name, parameter.kind, default=each.default, annotation=types[each.name])
                for each in fields(group)
            ]

    @functools.wraps(command)
    def run(**words: Any) -> None:
        given = {
            name: group(**{each.name: words.pop(each.name) for each in fields(group)}) for name, group in groups.items()
        }
        command(**words, **given)

    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    return run
