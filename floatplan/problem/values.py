"""What the keys of a problem file hold, as types of pydantic: numbers, angles, lists in joint order, tables by joint.

Validated with the context ``{"degrees": True}``, every angle comes out in radians.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeAlias, Union

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


def limits_by_joint(each: Any, in_urdf: bool) -> Any:
    """Return the type of limits, numbers or angles, that the URDF may give."""
    words = ("urdf", "none") if in_urdf else ("none",)
    entry = Annotated[
        Annotated[Literal["none"], Tag("<word>")] | Annotated[each, Tag("<number>")], any_of("a number or 'none'")
    ]
    shapes = (
        Annotated[dict[str, each], Tag("<table>")],
        Annotated[list[entry | None], Tag("<list>")],
        Annotated[Literal[words], Tag("<word>")],
        Annotated[each, Tag("<number>")],
    )
    return Annotated[Union[shapes], any_of(f"{', '.join(map(repr, words))}, a number, or a table by joint")]  # noqa: UP007
