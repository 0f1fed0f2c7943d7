"""Data of the report's page: samples of the motion, the weights from which the robot's links move, and tables.

The page moves the robot as :class:`~floatplan.robot.planar.tree.PlanarTree` does, from orientation and joints, so that
a few numbers per instant move any robot. Columns are in SI units and radians. Tables are text.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.colors import to_hex
from numpy.typing import ArrayLike

from floatplan.arguments import short
from floatplan.arrays import Array
from floatplan.files import json_value
from floatplan.jumps.check import JumpCheck, sentences_on
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.spatial.standing import Foot
from floatplan.plans.plan import Plan
from floatplan.plans.presentation import CHECKED, Row, proof_rows, result_rows, utilisation_table
from floatplan.plans.trajectory import Trajectory
from floatplan.plans.verdicts import TONES, Tone
from floatplan.problem.attitude import required
from floatplan.problem.ground_step import GroundStep
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import frame_position
from floatplan.view import outlines
from floatplan.view.charts import Chart, ReferenceLine, largest
from floatplan.view.jumps import CheckedJump, flies_in_space, footing
from floatplan.view.sampled import SampledPlan, attitude_axes
from floatplan.view.solids import obstacle_corners, obstacle_solid, rendered_solids
from floatplan.view.style import PALETTE, palette

PHASES = ("phase", "s", "from", "to", "on the ground")  # titles of tables
STANCES = ("stances", "limit")


def motion_data(sampled: SampledPlan) -> dict[str, Any]:
    """Return all that moves: duration, columns (names to samples), robot, frames, obstacles, ghosts, ground, box."""
    plan = sampled.plan
    final = sampled.plan.whole_problem.final
    if flies_in_space(plan):
        return motion_in_space(plan, sampled)
    placed = outlines.postures(plan, outlines.snapshot_times(plan))
    com = outlines.pairs(outlines.com_path(plan, np.array([plan.duration])))[0]
    box = outlines.picture_box(plan, outlines.postures(plan, np.linspace(0.0, plan.duration, 65)))
    ground = [[level, low.real, high.real] for level, low, high in outlines.ground_lines(plan, placed)]
    return {
        "duration": plan.duration,
        "columns": {name: rounded(values) for name, values in sampled.columns.items()},
        **scene_data(plan.whole_problem),
        "ghosts": rounded(placed.times),
        "goal": {"orientation": final.orientation, "positions": final.positions.tolist(), "com": com.tolist()},
        "ground": ground,
        "box": outlines.pairs(np.array(outlines.box_around(np.array(box), 0.02))).ravel().tolist(),
    }


def motion_in_space(plan: Trajectory, sampled: SampledPlan) -> dict[str, Any]:
    """Return the same of a motion in space.

    Frames of bodies are those of the joints of the robot's model; ``ball`` is a centre and a radius that contain the
    motion, ``floor`` lines on the ground; of a flight, ``vector`` is an arrow of the angular momentum, m, and ``scale``
    its magnitude.
    """
    problem = plan.whole_problem
    robot = plan.robot
    final = problem.final
    centre, radius = outlines.ball(plan)
    goal = outlines.posed(plan, final, plan.duration)
    shown = {name: values for name, values in sampled.columns.items() if not name.startswith("accelerations.")}
    frames = []
    for (name, role), colour in zip(_roles(problem).items(), PALETTE.trails[1:], strict=False):
        body, position = frame_position(robot.model, robot.joint_tree, name)
        frames.append({"name": name, "role": role, "colour": colour, "body": body - 1, "at": rounded(position)})
    obstacles = []
    for index, obstacle in enumerate(outlines.shown_obstacles(problem)):
        if obstacle.bounded:
            obstacles.append(_obstacle_in_space(index, obstacle))
    higher_ground = outlines.platform(plan)
    if higher_ground is not None:
        obstacles.append(_obstacle_in_space(0, higher_ground) | {"colour": PALETTE.pale})
    of_flight: dict[str, Any] = {"vector": None}
    if isinstance(plan, Plan):
        h = np.asarray(plan.angular_momentum)
        size_of_h = float(np.linalg.norm(h))
        of_flight["scale"] = f"angular momentum, {size_of_h:.4g} kg m²/s"
        if h.any():  # half as long as the robot, whatever h is
            of_flight["vector"] = rounded(0.5 * outlines.robot_size(plan) * h / size_of_h)
    moving = moving_robot(
        robot,
        shown,
        duration=plan.duration,
        ball=(centre, radius),
        floor=outlines.grids(plan),
        goal={
            "base": [*goal.places[0, 1], *required(final.attitude).quaternion],
            "positions": final.positions,
            "com": outlines.com_positions(plan, np.array([plan.duration]))[0],
        },
    )
    ghosts = rounded(outlines.snapshot_times(plan))
    return {**moving, "frames": frames, "obstacles": obstacles, "ghosts": ghosts, **of_flight}


def moving_robot(
    robot: Robot,
    columns: Mapping[str, Array],
    *,
    duration: float,
    ball: tuple[Array, float],
    floor: Sequence[Array],
    goal: Mapping[str, ArrayLike],
) -> dict[str, Any]:
    """Return what the page needs to move a robot in space, with nothing around it but a floor.

    Parameters
    ----------
    robot : Robot
    columns : of (K,) samples each, by their names, at equal steps of time
    duration : float, s
    ball : centre (3,) and radius, m
        Of what contains the motion.
    floor : of (., 3)
        Lines on the ground.
    goal : Mapping
        At the end: ``base``, position and quaternion (x, y, z, w) (7,), ``positions`` of the joints (n,), ``com`` (3,).
    """
    centre, radius = ball
    return {
        "duration": duration,
        "columns": {name: rounded(values) for name, values in columns.items()},
        "robot": robot_in_space(robot),
        "frames": [],
        "trail": PALETTE.trails[0],
        "obstacles": [],
        "ground": [],
        "floor": [rounded(line) for line in floor],
        "ghosts": [],
        "goal": {name: rounded(values) for name, values in goal.items()},
        "ball": {"centre": rounded(centre), "radius": radius},
        "vector": None,
    }


def _obstacle_in_space(index: int, obstacle: Obstacle) -> dict[str, Any]:
    """An obstacle's corners, triangles between them, corners with its margin, how it moves, and when it exists."""
    points, faces = obstacle_solid(obstacle)
    grown = obstacle_corners(obstacle, obstacle.margin) if obstacle.margin > 0 else np.empty((0, 3))
    return {
        "colour": PALETTE.obstacles[index % len(PALETTE.obstacles)],
        "points": rounded(points),
        "faces": faces.tolist(),
        "grown": rounded(grown),
        "margin": obstacle.margin,
        "velocity": list(obstacle.velocity),
        "window": None if obstacle.window is None else list(obstacle.window),
    }


def robot_in_space(robot: Robot) -> dict[str, Any]:
    """Joints, links' solids, and bodies: the pose of each in its parent with joints at zero, and its joint's axis."""
    model = robot.model
    bodies = [dict[str, Any](parent=None, turns=[])]
    data = model.createData()
    pin.forwardKinematics(model, data, robot.reference)
    for joint in range(2, model.njoints):
        pose = data.liMi[joint]
        body = {
            "parent": model.parents[joint] - 1,
            "rests": rounded(pose.rotation),
            "at": rounded(pose.translation),
            "axis": rounded(robot.joint_tree.joint[model.names[joint]].axis),
            "turns": rounded(robot.selection[model.idx_vs[joint]]),
        }
        bodies.append(body)
    links = []
    for solid in rendered_solids(robot):
        link = {
            "link": solid.link,
            "body": solid.body - 1,
            "segment": solid.segment,
            "points": rounded(solid.points),
            "faces": solid.faces,
            "radius": 0.0,
        }
        links.append(link)
    return {"joints": list(robot.joints), "bodies": bodies, "links": links, **_colours(robot)}


def _colours(robot: Robot) -> dict[str, list[str]]:
    return {"colours": list(map(to_hex, palette(len(robot.joints) + 1)))}


def sample_grid(duration: float) -> Array:
    """Instants (N,) of the columns, s: evenly spaced, the middle of the flight among them."""
    # at 300 Hz, odd, so that its middle is a sample; more than 2401 make the page large and show nothing new
    count = int(np.clip(duration * 300, 600, 2400)) // 2 * 2 + 1
    return np.linspace(0.0, duration, count)


def chart_data(chart: Chart, sampled: SampledPlan) -> dict[str, Any]:
    """Return a chart as the page reads it.

    It has a title, a unit, a factor from SI to it, ``series`` (name, colour, key of its column, segment) and ``lines``
    (name, colour, one value or samples, segment): limits, margins and the interval of h. ``beyond`` describes limits
    that would flatten the curves.
    """
    lines: list[ReferenceLine] = []
    beyond: list[str] = []
    for panel in chart.panels:
        shown, omitted = panel.lines(max(largest(sampled.columns[curve.key]) for curve in panel.curves))
        lines += shown
        if omitted and panel.interval is not None:
            beyond.append("without turning back: h from {:.4g} to {:.4g}".format(*panel.interval))
        elif omitted:
            least = min(np.abs(line.value).min() for line in omitted)
            beyond.append(f"limits from {least:.4g}, not drawn")
    data: dict[str, Any] = {"range": chart.panels[0].range}
    ends = [curve.ends for curve in chart.curves if curve.ends is not None]
    if len(ends) == len(chart.curves):
        data["starts"], data["goals"] = zip(*ends, strict=True)
    series = []
    for curve in chart.curves:
        entry = {"name": curve.name, "colour": to_hex(curve.colour), "key": curve.key, "segment": curve.segment}
        if curve.limit is not None:
            least = float(np.min(curve.limit))  # for the chosen curve
            entry["limit"] = f"of {least:.4g} {chart.unit}" if np.isfinite(least) else "no limit"
        series.append(entry)
    return data | {
        "title": chart.title,
        "unit": chart.unit,
        "factor": chart.factor,
        "series": series,
        "lines": list(map(_line_data, lines)),
        "beyond": beyond[0] if beyond else "",
    }


def _line_data(line: ReferenceLine) -> dict[str, Any]:
    is_constant = np.ptp(line.value) == 0
    value = rounded(np.unique(line.value)[0] if is_constant else line.value)
    return {"name": line.name, "colour": to_hex(line.colour), "value": value, "segment": line.segment}


def scene_data(problem: Problem) -> dict[str, Any]:
    """Return the robot and the obstacles as a page shows them, whatever the motion.

    ``robot``; ``frames`` that leave a trail, and how they are marked; the colour of the centre of mass's ``trail``;
    ``obstacles``: their capsules, two ends and a radius each, their margins, how they move, and when they exist.
    """
    robot = problem.robot
    frames = []
    for (name, role), colour in zip(_roles(problem).items(), PALETTE.trails[1:], strict=False):
        frame = robot.frames[name]
        frames.append(_frame(name, role, colour, frame.body, frame.local))
    obstacles = []
    for index, obstacle in enumerate(outlines.shown_obstacles(problem)):
        capsules = []
        for start, end, radius in outlines.obstacle_capsules(obstacle):
            capsules.append((*rounded(outlines.pairs(np.array([start, end]))), radius))
        entry = {
            "bounded": obstacle.bounded,
            "colour": PALETTE.obstacles[index % len(PALETTE.obstacles)],
            "capsules": capsules,
            "margin": obstacle.margin,
            "velocity": list(obstacle.velocity),
            "window": None if obstacle.window is None else list(obstacle.window),
        }
        obstacles.append(entry)
    return {"robot": _robot(problem), "frames": frames, "trail": PALETTE.trails[0], "obstacles": obstacles}


def _roles(problem: Problem) -> dict[str, str]:
    roles = {problem.takeoff.frame: "takes off"}
    return roles | {problem.landing.frame: "takes off and lands" if problem.landing.frame in roles else "lands"}


def _frame(name: str, role: str, colour: str, body: int, position: complex) -> dict[str, Any]:
    """A frame at a position on a body, m."""
    return {"name": name, "role": role, "colour": colour, "body": body, "at": rounded(outlines.pairs(position))}


def _robot(problem: Problem) -> dict[str, Any]:
    robot = problem.robot
    tree = problem.robot.tree
    bodies = np.arange(len(tree.mass))
    links = []
    capsules = outlines.rendered_capsules(robot)
    segments = outlines.capsule_segments(robot).tolist()
    radii = outlines.rendered_radii(problem).tolist()
    for capsule, segment, radius in zip(capsules, segments, radii, strict=True):
        link = {
            "body": capsule.body,
            "segment": segment,
            "radius": radius,
            "points": rounded(outlines.pairs(np.array([capsule.start, capsule.end]))),
            "faces": [],
        }
        links.append(link)
    return {
        "joints": list(robot.joints),
        "turn": tree.turn,
        "turns": rounded(tree.turns),
        "offsets": rounded(tree.offsets),
        "origins": rounded(outlines.pairs(tree.point_weights(bodies, np.zeros(len(bodies), dtype=np.complex128)))),
        "links": links,
        **_colours(robot),
    }


def rounded(values: Any) -> Any:
    """Return numbers, or lists of them, of 11 digits, which compare with the plan to 1e-6; None where not finite."""
    array = np.asarray(values, dtype=np.float64)
    return json_value(float(f"{array:.11g}")) if array.ndim == 0 else list(map(rounded, array))


def sections(plan: Plan, stances: Sequence[Row] = ()) -> list[dict[str, Any]]:
    """Return the tables of the report: title, rows of (name, text), and a tone: good, bad or open.

    ``stances`` are rows about the stances before and after the flight, if any.
    """
    certificate = plan.certificate
    tables: list[dict[str, Any]] = [
        {"title": "Problem", "rows": plan.problem.rows()},
        {
            "title": "Result",
            "rows": [*result_rows(plan), *stances],
            "tone": "good" if plan.ok else "bad",
            "note": plan.explanation,
        },
        {"title": "Proved", **proved(plan), "findings": certificate.table() if certificate else ((), [])},
        {"title": "Use of limits", "rows": [], "motors": utilisation_table(plan.utilisation)},
    ]
    return [*tables, *warned(plan)]


def proved(plan: Plan) -> dict[str, Any]:
    """Return the table of what was proved of a plan."""
    none = "none in space yet" if flies_in_space(plan) else "none in the plan file; floatplan certify --save makes one"
    proof = proof_rows(plan) or [Row("certificate", none)]
    tone = "open" if plan.certificate is None else TONES[plan.certificate.verdict]
    replay = plan.record.replay
    words = "none in the plan file; floatplan replay --save makes one"
    if replay is not None:
        landed = "lands at the goal" if replay.get("landed") else "lands elsewhere"
        error = short(replay.get("orientation_error"))
        words = f"{replay.get('engine')}: {landed}, orientation off by {error} rad"
    return {"rows": [*proof, Row("replay", words)], "tone": tone}


def warned(shown: Trajectory) -> list[dict[str, Any]]:
    """Return the table of the warnings of a plan or a jump, if there are any."""
    rows = []
    for warning in shown.warnings:
        kind = "out of plane" if warning.kind == "leak" else warning.kind.replace("_", " ")
        rows.append(Row(f"{kind} {warning.subject}", warning.message))
    return [{"title": "Warnings", "rows": rows, "tone": "open"}] if rows else []


def phase_lines(jump: JumpMotion) -> list[list[str]]:
    """Cells of a jump's phases, under ``PHASES``."""
    rolling = set[str]()
    for stance in jump.stances:
        for contact in stance.contacts:
            if contact.radius:
                rolling.update(contact.names)
    lines = []
    for phase in jump.phases:
        times = [f"{time:.3f}" for time in (phase.end - phase.begin, phase.begin, phase.end)]
        stands = ", ".join(f"{name} (rolls)" if name in rolling else name for name in phase.contacts)
        lines.append([phase.kind, *times, stands or "nothing"])
    return lines


def check_lines(check: JumpCheck, request: JumpRequest) -> tuple[list[list[str]], list[list[str]]]:
    """Cells of the findings of a jump's check, under ``STANCES``: broken limits, and those that are satisfied."""
    figures = dict(check.figures)
    if not figures.get("torque_speed", 1.0) > 0:
        del figures["torque_speed"]
    broken, satisfied = sentences_on(request, figures, check.unlimited)
    return [[f"not within limits: {words}", limit] for words, limit in broken], list(map(list, satisfied))


def request_rows(problem: Problem, request: JumpRequest) -> list[Row]:
    """Return the requirements on a jump: of its flight what is fixed, since all else is a guess."""
    of_flight = {"start": "start", "goal": "goal", "duration": "duration", "momentum": "angular_momentum"}
    chosen_by_search = ("takes off", "lands", "speed")
    rows = []
    for name, text in problem.rows():
        is_guess = name in of_flight and of_flight[name] not in request.fixed
        if name not in chosen_by_search and not is_guess:
            rows.append(Row(name, text))
    if problem.robot.base == "free-flyer":
        rows.append(Row("turns", _turns_in_words(problem)))
    else:
        start_turns = round(problem.initial.orientation / (2 * np.pi))
        goal_turns = round(problem.final.orientation / (2 * np.pi))
        rows.append(Row("whole turns", f"{goal_turns - start_turns}"))
    for name, end in (("from", request.takeoff.from_), ("to", request.landing.to)):
        angles = [] if isinstance(end, str) else [f"{joint} {np.degrees(angle):.4g}°" for joint, angle in end.items()]
        rows.append(Row(name, ", ".join(angles) or "standing"))
    if request.takeoff.com_velocity is not None:
        along, up = request.takeoff.com_velocity
        rows.append(Row("begins with", f"{along:.3g} m/s horizontally, {up:.3g} m/s vertically"))
    shares = "{torque:.0%} of torques, {velocity:.0%} of rates".format(**request.margin)
    return [*rows, Row("friction", f"{request.friction:g}"), Row("stances use", shares)]


def _turns_in_words(problem: Problem) -> str:
    """By how much the base turns in space, about each axis, for a person."""
    axes, names = attitude_axes(problem)
    start = required(problem.initial.attitude).angles_about(axes)
    goal = required(problem.final.attitude).angles_about(axes)
    words = []
    for name, axis, angle in zip(names, axes, np.degrees(np.asarray(goal) - start), strict=True):
        if abs(angle) > 0.01:
            words.append(f"{name} about {axis} by {angle:.4g}°")
    return ", ".join(words) or "none"


def jump_sections(jump: JumpMotion, tone: Tone, simulated: Sequence[Row] = ()) -> list[dict[str, Any]]:
    """Return the tables of a jump's report, as those of a plan's; ``simulated`` are rows about a simulated jump."""
    force = footing(jump).sizes.sum(axis=1).max()
    problem = jump.whole_problem
    weights = force / (jump.robot.mass * problem.flight.gravity)
    result = [
        Row("height", f"centre of mass up to {jump.height:.3g} m above the ground"),
        Row("largest force of all feet", f"{force:.4g} N, {weights:.2g} times the weight"),
    ]
    of_both: list[dict[str, Any]] = [
        {"title": "Problem", "rows": request_rows(jump.problem, jump.request)},
        {"title": "Result", "rows": result, "tone": tone, "motors": (PHASES, phase_lines(jump))},
    ]
    if not isinstance(jump, CheckedJump) or jump.flight is None:
        return [*of_both, {"title": "Flown", "rows": [*simulated], "tone": tone}]
    broken, satisfied = check_lines(jump.check, jump.request)
    stances = (STANCES, [*broken, *satisfied])
    return [
        *of_both,
        {"title": "Flight", **proved(jump.flight)},
        {"title": "Stances", "rows": [], "tone": "bad" if broken else "good", "motors": stances, "note": CHECKED},
        *warned(jump),
    ]


def jump_data(jump: JumpMotion) -> dict[str, Any]:
    """Return the data of a jump's picture that a flight's has not.

    ``frames``, the contacts, each with the columns of its ``force`` and where this ``acts``; ``flown``, each
    flight from and to, s; the corners of the ``step`` of the ground, m, if it has one; a friction ``cone``, the
    ``metres_per_newton`` of forces in the picture, and the ``scale`` in words; in space the height of the ground on
    which the robot casts its ``shadow``, and where this is the ``higher`` one.
    """
    standing = footing(jump)
    is_spatial = flies_in_space(jump)
    step = outlines.ground_step(jump)
    frames = []
    for index, (name, contact) in enumerate(standing.contacts.items()):
        entry: dict[str, Any] = {"name": name, "role": "stands", "colour": standing.colours[name]}
        if isinstance(contact, Foot):
            entry |= {"body": contact.body - 1, "at": rounded(contact.local)}
        else:
            spot = contact.spots[0]
            entry |= {"body": spot.body, "at": rounded(outlines.pairs(spot.place))}
        entry["force"] = [f"force_{letter}.{index}" for letter in standing.axes]
        entry["acts"] = [f"foot_{letter}.{index}" for letter in standing.axes]
        frames.append(entry)
    return {
        "frames": frames,
        "flown": [[flight.begin, flight.end] for flight in jump.timed_flights],
        "step": None if step is None else outlines.pairs(np.array(step)).ravel().tolist(),
        "cone": rounded(standing.cone_in_world if is_spatial else outlines.pairs(standing.cone)),
        "scale": standing.scale,
        "metres_per_newton": standing.metres_per_newton,
        "shadow": jump.ground if is_spatial else None,
        "higher": _higher_ground(jump.step) if is_spatial else None,
    }


def _higher_ground(step: GroundStep | None) -> dict[str, Any] | None:
    """Where in space the ground is how much higher: beyond ``edge`` along an ``axis``, in the direction ``inwards``."""
    if step is None:
        return None
    return {"axis": step.axis, "edge": step.edge, "inwards": step.inwards, "height": step.high - step.low}
