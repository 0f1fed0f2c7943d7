"""What the keys of a problem file hold, as types of pydantic: numbers, angles, lists in joint order, tables by joint.

Validated with the context ``{"degrees": True}``, every angle comes out in radians.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import AfterValidator, Discriminator, Field, Tag, ValidationInfo


def _in_radians(value: float, info: ValidationInfo) -> float:
    return math.radians(value) if info.context and info.context["degrees"] else value


def _shape(value: Any) -> str:
    """Tag of the shape that a value has; tags are in angle brackets, so that no path in a message shows them."""
    for shape, kind in (("<table>", dict), ("<list>", list), ("<word>", str)):
        if isinstance(value, kind):
            return shape
    return "<number>"


def any_of(wanted: str) -> Discriminator:
    """Tell apart by their shapes what a key may hold; else it is not ``wanted``."""
    return Discriminator(_shape, custom_error_type="wrong_shape", custom_error_message=f"is not {wanted}")


Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole: TypeAlias = Annotated[int, Field(strict=True)]
Angle: TypeAlias = Annotated[Number, AfterValidator(_in_radians)]
Place: TypeAlias = tuple[Number, Number]
Range: TypeAlias = tuple[Angle, Angle]

JointAngles: TypeAlias = Annotated[
    Annotated[dict[str, Angle], Tag("<table>")]
    | Annotated[list[Angle], Tag("<list>")]
    | Annotated[Angle, Tag("<number>")],
    any_of("a number, a list in joint order, or a table by joint"),
]
Velocities: TypeAlias = Annotated[
    Annotated[dict[str, Angle], Tag("<table>")]
    | Annotated[list[Angle], Tag("<list>")]
    | Annotated[Literal["takeoff", "landing"], Tag("<word>")]
    | Annotated[Angle, Tag("<number>")],
    any_of("a number, a list in joint order, a table by joint, or 'takeoff' or 'landing'"),
]
Accelerations: TypeAlias = Annotated[
    Annotated[dict[str, Angle], Tag("<table>")]
    | Annotated[list[Angle], Tag("<list>")]
    | Annotated[Literal["free"], Tag("<word>")]
    | Annotated[Angle, Tag("<number>")],
    any_of("a number, a list in joint order, a table by joint, or 'free'"),
]
PositionLimits: TypeAlias = Annotated[
    Annotated[dict[str, Range], Tag("<table>")]
    | Annotated[list[Range], Tag("<list>")]
    | Annotated[Literal["urdf", "full"], Tag("<word>")],
    any_of("'urdf', 'full', or a table of [low, high] by joint"),
]
AngularLimit: TypeAlias = Annotated[
    Annotated[Literal["none"], Tag("<word>")] | Annotated[Angle, Tag("<number>")], any_of("a number or 'none'")
]
AngularLimits: TypeAlias = Annotated[
    Annotated[dict[str, Angle], Tag("<table>")]
    | Annotated[list[AngularLimit | None], Tag("<list>")]
    | Annotated[Literal["urdf", "none"], Tag("<word>")]
    | Annotated[Angle, Tag("<number>")],
    any_of("'urdf', 'none', a number, or a table by joint"),
]
AccelerationLimits: TypeAlias = Annotated[
    Annotated[dict[str, Angle], Tag("<table>")]
    | Annotated[list[AngularLimit | None], Tag("<list>")]
    | Annotated[Literal["none"], Tag("<word>")]
    | Annotated[Angle, Tag("<number>")],
    any_of("'none', a number, or a table by joint"),
]
TorqueLimit: TypeAlias = Annotated[
    Annotated[Literal["none"], Tag("<word>")] | Annotated[Number, Tag("<number>")], any_of("a number or 'none'")
]
TorqueLimits: TypeAlias = Annotated[
    Annotated[dict[str, Number], Tag("<table>")]
    | Annotated[list[TorqueLimit | None], Tag("<list>")]
    | Annotated[Literal["urdf", "none"], Tag("<word>")]
    | Annotated[Number, Tag("<number>")],
    any_of("'urdf', 'none', a number, or a table by joint"),
]
AngularMomentum: TypeAlias = Annotated[
    Annotated[Literal["midpoint", "free"], Tag("<word>")] | Annotated[Number, Tag("<number>")],
    any_of("a number, 'midpoint' or 'free'"),
]
Degree: TypeAlias = Annotated[
    Annotated[list[Whole], Tag("<list>")]
    | Annotated[Literal["auto"], Tag("<word>")]
    | Annotated[Whole, Tag("<number>")],
    any_of("a whole number, a list of them, or 'auto'"),
]
