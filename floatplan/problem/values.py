"""What keys of files hold, as types of pydantic: numbers, angles, and values of several shapes.

Validated with the context ``{"degrees": True}``, every angle comes out in radians.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, TypeAlias

from pydantic import AfterValidator, Discriminator, Field, ValidationInfo


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
