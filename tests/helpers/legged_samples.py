"""URDF text of small robots on legs: quadrupeds and bipeds, on points, soles or wheels, in any zero posture."""

from collections.abc import Sequence


def inertial(mass: float, center: str = "0 0 0") -> str:
    """An ``<inertial>`` element of a small ball of that mass."""
    moment = 0.002 * mass
    moments = f'ixx="{moment}" ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"'
    return f'<inertial><origin xyz="{center}"/><mass value="{mass}"/><inertia {moments}/></inertial>'


def ball(radius: float, place: str = "0 0 0") -> str:
    """A ``<collision>`` element."""
    return f'<collision><origin xyz="{place}"/><geometry><sphere radius="{radius}"/></geometry></collision>'


def box(size: str, place: str = "0 0 0") -> str:
    """A ``<collision>`` element."""
    return f'<collision><origin xyz="{place}"/><geometry><box size="{size}"/></geometry></collision>'


def wheel(radius: float, width: float) -> str:
    """A ``<collision>`` element of a wheel that turns about y."""
    shape = f'<cylinder radius="{radius}" length="{width}"/>'
    return f'<collision><origin xyz="0 0 0" rpy="1.5707963 0 0"/><geometry>{shape}</geometry></collision>'


def link(name: str, mass: float, *shapes: str, center: str = "0 0 0") -> str:
    """A ``<link>`` element."""
    return f'<link name="{name}">{inertial(mass, center)}{"".join(shapes)}</link>'


def hinge(
    name: str,
    parent: str,
    child: str,
    place: str,
    limits: tuple[float, float] | None = (-2.5, 2.5),
    axis: str = "0 1 0",
    turned: float = 0.0,
) -> str:
    """A ``<joint>`` element, its zero turned by an angle about y, rad; continuous where it has no limits."""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{place}" rpy="0 {turned} 0"/>'
    span = "" if limits is None else f'lower="{limits[0]}" upper="{limits[1]}" '
    kind = "continuous" if limits is None else "revolute"
    limit = f'<limit {span}effort="40" velocity="25"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<axis xyz="{axis}"/>{limit}</joint>'


def fixed(name: str, parent: str, child: str, place: str) -> str:
    """A ``<joint>`` element that does not move."""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
    return f'<joint name="{name}" type="fixed">{ends}</joint>'


def leg(
    name: str,
    place: tuple[float, float],
    *,
    turned: tuple[float, float] = (0.0, 0.0),
    knee: tuple[float, float] = (-2.4, 2.4),
    foot: str = "point",
) -> str:
    """Hip, thigh of 0.22 m, knee, shank of 0.2 m and a foot: a "point", a "sole" on an ankle, or a "wheel".

    ``turned`` are the zeros of hip and knee, rad; ``place`` is the hip's, ahead and beside.
    """
    parts = [
        hinge(f"{name}_hip", "body", f"{name}_thigh", f"{place[0]} {place[1]} 0", turned=turned[0]),
        link(f"{name}_thigh", 0.6, box("0.03 0.03 0.14", "0 0 -0.11"), center="0 0 -0.11"),
        hinge(f"{name}_knee", f"{name}_thigh", f"{name}_shank", "0 0 -0.22", knee, turned=turned[1]),
        link(f"{name}_shank", 0.3, box("0.02 0.02 0.1", "0 0 -0.09"), center="0 0 -0.1"),
    ]
    if foot == "point":
        parts += [fixed(f"{name}_tip", f"{name}_shank", f"{name}_foot", "0 0 -0.2")]
        parts += [link(f"{name}_foot", 0.05, ball(0.02))]
    elif foot == "sole":
        parts += [hinge(f"{name}_ankle", f"{name}_shank", f"{name}_foot", "0 0 -0.2", (-1.0, 1.0))]
        parts += [link(f"{name}_foot", 0.3, box("0.2 0.06 0.03", "0.03 0 -0.035"), center="0.03 0 -0.03")]
    else:
        parts += [hinge(f"{name}_roll", f"{name}_shank", f"{name}_wheel", "0 0 -0.2", None)]
        parts += [link(f"{name}_wheel", 0.3, wheel(0.06, 0.03))]
    return "".join(parts)


def legged(*parts: str, mass: float = 7.0, more: Sequence[str] = ()) -> str:
    """A robot of a body and legs."""
    body = link("body", mass, box("0.34 0.16 0.08", "0 0 0.05"), center="0 0 0.04")
    return f'<robot name="legged">{body}{"".join(parts)}{"".join(more)}</robot>'


def quadruped(**of_legs: object) -> str:
    """Four legs alike."""
    places = {"fl": (0.18, 0.11), "fr": (0.18, -0.11), "hl": (-0.18, 0.11), "hr": (-0.18, -0.11)}
    return legged(*(leg(name, place, **of_legs) for name, place in places.items()))  # type: ignore[arg-type]


def biped(**of_legs: object) -> str:
    """Two legs alike, side by side."""
    places = {"left": (0.0, 0.1), "right": (0.0, -0.1)}
    return legged(*(leg(name, place, **of_legs) for name, place in places.items()))  # type: ignore[arg-type]
