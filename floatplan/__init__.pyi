# The public names, and where each one is defined: read by type checkers, and by __init__.py when it runs.
from floatplan.certificate.certify import certify as certify
from floatplan.errors import FloatplanError as FloatplanError
from floatplan.errors import InputError as InputError
from floatplan.motion.flight_state import FlightState as FlightState
from floatplan.planning.many import plan_many as plan_many
from floatplan.planning.planner import plan as plan
from floatplan.plans.plan import Plan as Plan
from floatplan.plans.plan_file import load_plan as load_plan
from floatplan.plans.plans import Plans as Plans
from floatplan.plans.verdicts import Certificate as Certificate
from floatplan.problem.family import Family as Family
from floatplan.problem.file import load_problem as load_problem
from floatplan.problem.file import save_problem as save_problem
from floatplan.problem.parts import Bar as Bar
from floatplan.problem.parts import Circle as Circle
from floatplan.problem.parts import Flight as Flight
from floatplan.problem.parts import HalfPlane as HalfPlane
from floatplan.problem.parts import Landing as Landing
from floatplan.problem.parts import Limits as Limits
from floatplan.problem.parts import Motion as Motion
from floatplan.problem.parts import Motor as Motor
from floatplan.problem.parts import Posture as Posture
from floatplan.problem.parts import SelfClearance as SelfClearance
from floatplan.problem.parts import Takeoff as Takeoff
from floatplan.problem.problem import Problem as Problem
from floatplan.robot.robot import Coupling as Coupling
from floatplan.robot.robot import Robot as Robot
from floatplan.simulation.replay import Replay as Replay
from floatplan.simulation.replay import replay as replay
from floatplan.studies.study import Study as Study
from floatplan.studies.study import study as study

__version__: str
