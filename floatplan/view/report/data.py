"""Data of the report's page: samples of the motion, the weights that place the robot's links from them, and tables.

The page places the robot as :class:`~floatplan.robot.planar.tree.PlanarTree` does, from orientation and joints, so that
a few numbers per instant move any robot. Columns are in SI units and radians. Tables are plain text.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.colors import to_hex

from floatplan.arguments import short
from floatplan.arrays import Array
from floatplan.files import plain
from floatplan.jumps.check import JumpCheck, judged
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.plan import Plan
from floatplan.plans.presentation import CHECKED, Row, proof_rows, result_rows, utilisation_table
from floatplan.plans.trajectory import Trajectory
from floatplan.plans.verdicts import TONES, Tone
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import frame_place
from floatplan.view import outlines
from floatplan.view.charts import Chart, ReferenceLine, largest
from floatplan.view.jumps import CheckedJump, footing
from floatplan.view.sampled import SampledPlan, flies_in_space
from floatplan.view.solids import drawn_solids
from floatplan.view.style import OBSTACLES, TRAILS, palette

FEWEST_SAMPLES = 601  # [-] samples of a flight; odd, so that its middle is one
MOST_SAMPLES = 2401
SAMPLE_RATE = 300  # [Hz]
DIGITS = 11  # [-] of the numbers in the page, which compares with the plan to 1e-6
PHASES = ("phase", "s", "from", "to", "on the ground")  # titles of tables
STANCES = ("stances", "limit")
OF_FLIGHT = {"start": "start", "goal": "goal", "duration": "duration", "momentum": "angular_momentum"}  # unless fixed
OF_FLIGHT |= dict.fromkeys(("takes off", "lands", "speed"), "never")  # what a jump finds itself
VECTOR = 0.5  # [-] length of the angular momentum as drawn, in sizes of the robot
BOX_PAD = 0.02  # [-] room around what is drawn


def motion_data(sampled: SampledPlan) -> dict[str, Any]:
    """Return all that moves: duration, columns (names to samples), robot, frames, obstacles, ghosts, ground, box."""
    plan = sampled.plan
    final = sampled.plan.whole_problem.final
    if flies_in_space(plan):
        return motion_in_space(plan, sampled)
    placed = outlines.postures(plan, outlines.snapshot_times(plan))
    com = outlines.pairs(outlines.com_path(plan, np.array([plan.duration])))[0]
    box = outlines.picture_box(plan, outlines.postures(plan, np.linspace(0.0, plan.duration, 65)))
    return {
        "duration": plan.duration,
        "columns": {name: rounded(values) for name, values in sampled.columns.items()},
        **scene_data(plan.whole_problem),
        "ghosts": rounded(placed.times),
        "goal": {"orientation": final.orientation, "positions": final.positions.tolist(), "com": com.tolist()},
        "ground": [[level, low.real, high.real] for level, low, high in outlines.ground_lines(placed)],
        "box": outlines.pairs(np.array(outlines.box_around(np.array(box), BOX_PAD))).ravel().tolist(),
    }


def motion_in_space(plan: Plan, sampled: SampledPlan) -> dict[str, Any]:
    """Return the same of a flight in space.

    Frames of bodies are those of the joints of the robot's model; ``ball`` is a place and a radius that hold the
    motion, ``floor`` lines on the ground, ``vector`` the angular momentum as drawn, m, and ``scale`` what it is.
    """
    problem = plan.problem
    robot = plan.robot
    final = plan.problem.final
    h = np.asarray(plan.angular_momentum)
    (centre, radius) = outlines.ball(plan)
    whole: Any = plan.whole
    goal = whole.posture(final, plan.duration)
    columns = {name: values for name, values in sampled.columns.items() if name.partition(".")[0] != "accelerations"}
    return {
        "duration": plan.duration,
        "columns": {name: rounded(values) for name, values in columns.items()},
        "robot": _robot_in_space(robot),
        "frames": [
            {"name": name, "role": role, "colour": colour, "body": body - 1, "at": rounded(place)}
            for (name, role), colour in zip(_roles(problem).items(), TRAILS[1:], strict=False)
            for body, place in [frame_place(robot.model, robot.joint_tree, name)]
        ],
        "trail": TRAILS[0],
        "obstacles": [],
        "ground": [],
        "floor": [rounded(line) for line in outlines.floor(plan)],
        "ghosts": rounded(outlines.snapshot_times(plan)),
        "goal": {
            "base": rounded([*goal.places[0, 1], *plan.whole.orientation_at_ends["goal"]["quaternion_xyzw"]]),
            "positions": final.positions.tolist(),
            "com": rounded(plan.ballistics.positions(np.array([plan.duration]))[0]),
        },
        "ball": {"centre": rounded(centre), "radius": radius},
        "vector": rounded(VECTOR * outlines.robot_size(plan) * h / np.linalg.norm(h)) if h.any() else None,
        "scale": f"angular momentum, {np.linalg.norm(h):.4g} kg m²/s",
    }


def _robot_in_space(robot: Robot) -> dict[str, Any]:
    """Joints, links' solids, and bodies: where each rests in its parent, and about which axis it turns from there."""
    model = robot.model
    bodies = [dict[str, Any](parent=None, turns=[])]
    data = model.createData()
    pin.forwardKinematics(model, data, robot.reference)
    for joint in range(2, model.njoints):
        rests = data.liMi[joint]
        axis = robot.joint_tree.joint[model.names[joint]].axis
        placed = {
            "parent": model.parents[joint] - 1,
            "rests": rounded(rests.rotation),
            "at": rounded(rests.translation),
        }
        bodies.append({**placed, "axis": rounded(axis), "turns": rounded(robot.selection[model.idx_vs[joint]])})
    links = [
        {**vars(solid), "body": solid.body - 1, "radius": 0.0, "points": rounded(solid.points)}
        for solid in drawn_solids(robot)
    ]
    return {"joints": list(robot.joints), "bodies": bodies, "links": links, **_colours(robot)}


def _colours(robot: Robot) -> dict[str, list[str]]:
    return {"colours": [to_hex(colour) for colour in palette(len(robot.joints) + 1)]}


def sample_grid(duration: float) -> Array:
    """Instants (N,) of the columns, s: evenly spaced, the middle of the flight among them."""
    count = int(np.clip(duration * SAMPLE_RATE, FEWEST_SAMPLES - 1, MOST_SAMPLES - 1)) // 2 * 2 + 1
    return np.linspace(0.0, duration, count)


def chart_data(chart: Chart, sampled: SampledPlan) -> dict[str, Any]:
    """Return a chart as the page reads it.

    It has a title, a unit, a factor from SI to it, ``series`` (name, colour, key of its column, part) and ``lines``
    (name, colour, one value or samples, part): limits, margins and the interval of h. ``beyond`` describes limits that
    would flatten the curves.
    """
    lines: list[ReferenceLine] = []
    beyond: list[str] = []
    for panel in chart.panels:
        drawn, left = panel.lines(max(largest(sampled.columns[curve.key]) for curve in panel.curves))
        lines += drawn
        if left and panel.interval is not None:
            beyond.append("without turning back: h from {:.4g} to {:.4g}".format(*panel.interval))
        elif left:
            beyond.append(f"limits from {min(np.abs(line.value).min() for line in left):.4g}, not drawn")
    data: dict[str, Any] = {"range": chart.panels[0].range}
    if all(curve.ends is not None for curve in chart.curves):
        data["starts"], data["goals"] = zip(*(curve.ends for curve in chart.curves if curve.ends), strict=True)
    series = [
        {"name": curve.name, "colour": to_hex(curve.colour), "key": curve.key, "part": curve.part}
        | ({} if curve.limit is None else {"limit": _limit(float(np.min(curve.limit)), chart.unit)})
        for curve in chart.curves
    ]
    return data | {
        "title": chart.title,
        "unit": chart.unit,
        "factor": chart.factor,
        "series": series,
        "lines": [
            vars(line)
            | {"colour": to_hex(line.colour)}
            | {"value": rounded(np.unique(line.value)[0] if np.ptp(line.value) == 0 else line.value)}
            for line in lines
        ],
        "beyond": beyond[0] if beyond else "",
    }


def _limit(least: float, unit: str) -> str:
    """A curve's least limit in words, for when it is chosen."""
    return f"of {least:.4g} {unit}" if np.isfinite(least) else "no limit"


def scene_data(problem: Problem) -> dict[str, Any]:
    """Return what a page needs to place and to paint robot and obstacles, whatever the motion.

    ``robot``; ``frames`` that leave a trail, and how they are marked; the colour of the centre of mass's ``trail``;
    ``obstacles``: their capsules, two ends and a radius each, their margins, how they move, and when they exist.
    """
    robot = problem.robot
    frames = [(name, role, robot.frames[name]) for name, role in _roles(problem).items()]
    return {
        "robot": _robot(problem),
        "frames": [
            _frame(name, role, colour, frame.body, frame.local)
            for (name, role, frame), colour in zip(frames, TRAILS[1:], strict=False)
        ],
        "trail": TRAILS[0],
        "obstacles": [
            {
                "bounded": obstacle.bounded,
                "colour": OBSTACLES[index % len(OBSTACLES)],
                "capsules": [
                    (*rounded(outlines.pairs(np.array(ends))), radius)
                    for *ends, radius in outlines.obstacle_capsules(obstacle)
                ],
                "margin": obstacle.margin,
                "velocity": list(obstacle.velocity),
                "window": None if obstacle.window is None else list(obstacle.window),
            }
            for index, obstacle in enumerate(problem.obstacles)
        ],
    }


def _roles(problem: Problem) -> dict[str, str]:
    roles = {problem.takeoff.frame: "takes off"}
    return roles | {problem.landing.frame: "takes off and lands" if problem.landing.frame in roles else "lands"}


def _frame(name: str, role: str, colour: str, body: int, place: complex) -> dict[str, Any]:
    """A frame at a place of a body, m."""
    return {"name": name, "role": role, "colour": colour, "body": body, "at": rounded(outlines.pairs(place))}


def _robot(problem: Problem) -> dict[str, Any]:
    robot = problem.robot
    tree = problem.robot.tree
    shapes = outlines.drawn_shapes(problem.robot)
    bodies = np.arange(len(tree.mass))
    columns = {
        "body": [shape.body for shape in shapes],
        "part": outlines.drawn_part(robot).tolist(),
        "radius": outlines.drawn_radius(problem).tolist(),
        "points": [rounded(outlines.pairs(np.array([shape.start, shape.end]))) for shape in shapes],
        "faces": [[] for _ in shapes],
    }
    return {
        "joints": list(robot.joints),
        "turn": tree.turn,
        "turns": rounded(tree.turns),
        "offsets": rounded(tree.offsets),
        "origins": rounded(outlines.pairs(tree.point_weights(bodies, np.zeros(len(bodies), dtype=np.complex128)))),
        "links": [dict(zip(columns, link, strict=True)) for link in zip(*columns.values(), strict=True)],
        **_colours(robot),
    }


def rounded(values: Any) -> Any:
    """Return numbers, or lists of them, of so many digits; None for what is not finite."""
    array = np.asarray(values, dtype=np.float64)
    return plain(float(f"{array:.{DIGITS}g}")) if array.ndim == 0 else [rounded(each) for each in array]


def sections(plan: Plan, stances: Sequence[Row] = ()) -> list[dict[str, Any]]:
    """Return the tables of the report: title, rows of (name, text), and a tone: good, bad or open.

    ``stances`` is what is said of those before and after the flight, if anything.
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
    none = "none in the plan file; floatplan certify --save makes one" if plan.robot.in_plane else "none in space yet"
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
    kinds = {"leak": "out of plane"}  # in words where the kind's name is none
    rows = [
        Row(f"{kinds.get(each.kind, each.kind.replace('_', ' '))} {each.subject}", each.message)
        for each in shown.warnings
    ]
    return [{"title": "Warnings", "rows": rows, "tone": "open"}] if rows else []


def phase_lines(jump: JumpMotion) -> list[list[str]]:
    """Cells of a jump's phases, under ``PHASES``."""
    lines = []
    rolling = {name for stance in jump.stances for each in stance.contacts if each.radius for name in each.names}
    for phase in jump.phases:
        times = (f"{at:.3f}" for at in (phase.end - phase.begin, phase.begin, phase.end))
        stands = ", ".join(f"{name} (rolls)" if name in rolling else name for name in phase.contacts)
        lines.append([phase.kind, *times, stands or "nothing"])
    return lines


def check_lines(check: JumpCheck, request: JumpRequest) -> tuple[list[list[str]], list[list[str]]]:
    """Cells of what a jump's check found, under ``STANCES``: what does not hold, and what does."""
    told = {name: value for name, value in check.figures.items() if name != "torque_speed" or value > 0}
    broken, held = judged(request, told, check.unlimited)
    return [[f"not within limits: {words}", limit] for words, limit in broken], [[*words] for words in held]


def asked_of_jump(problem: Problem, request: JumpRequest) -> list[Row]:
    """Return what a jump is asked: of its flight what it keeps alone, since the rest is a guess."""
    rows = [Row(*row) for row in problem.rows() if row[0] not in OF_FLIGHT or OF_FLIGHT[row[0]] in request.fixed]
    first, last = (round(end.orientation / (2 * np.pi)) for end in (problem.initial, problem.final))
    rows.append(Row("whole turns", f"{last - first}"))
    for name, end in (("from", request.takeoff.from_), ("to", request.landing.to)):
        angles = [] if isinstance(end, str) else [f"{joint} {np.degrees(angle):.4g}°" for joint, angle in end.items()]
        rows.append(Row(name, ", ".join(angles) or "standing"))
    shares = "{torque:.0%} of torques, {velocity:.0%} of rates".format(**request.margin)
    return [*rows, Row("friction", f"{request.friction:g}"), Row("stances use", shares)]


def jump_sections(jump: JumpMotion, tone: Tone, flown: Sequence[Row] = ()) -> list[dict[str, Any]]:
    """Return the tables of a jump's report, as those of a plan's; ``flown`` is what is said of one that was flown."""
    force = footing(jump).sizes.sum(axis=1).max()
    problem = jump.whole_problem
    weights = force / (jump.robot.mass * problem.flight.gravity)
    result = [
        Row("height", f"centre of mass up to {jump.height:.3g} m above the ground"),
        Row("largest force", f"{force:.4g} N, {weights:.2g} times the weight"),
    ]
    of_both: list[dict[str, Any]] = [
        {"title": "Problem", "rows": asked_of_jump(jump.problem, jump.request)},
        {"title": "Result", "rows": result, "tone": tone, "motors": (PHASES, phase_lines(jump))},
    ]
    if not isinstance(jump, CheckedJump) or jump.flight is None:
        return [*of_both, {"title": "Flown", "rows": [*flown], "tone": tone}]
    broken, held = check_lines(jump.check, jump.request)
    stances = (STANCES, [*broken, *held])
    return [
        *of_both,
        {"title": "Flight", **proved(jump.flight)},
        {"title": "Stances", "rows": [], "tone": "bad" if broken else "good", "motors": stances, "note": CHECKED},
        *warned(jump),
    ]


def jump_data(jump: JumpMotion) -> dict[str, Any]:
    """Return what the picture of a jump has beside a flight's.

    ``frames``, what stands, each with the columns of its ``force`` and where this ``acts``; when it has ``flown``, from
    and to, s; a friction ``cone``, the ``metres_per_newton`` of forces as drawn, and the ``scale`` in words.
    """
    standing = footing(jump)
    frames = []
    for index, (name, contact) in enumerate(standing.contacts.items()):
        spot = contact.spots[0]
        frame = _frame(name, "stands", standing.colours[name], spot.body, spot.place)
        columns = {
            "force": [f"force_x.{index}", f"force_z.{index}"],
            "acts": [f"foot_x.{index}", f"foot_z.{index}"],
        }
        frames.append(frame | columns)
    return {
        "frames": frames,
        "flown": jump.flight_span,
        "cone": rounded(outlines.pairs(standing.cone)),
        "scale": standing.scale,
        "metres_per_newton": standing.metres_per_newton,
    }
