"""Flights in space: every model encloses what Newton's and Euler's equations of the links give with 200 bits."""

import flint
import numpy as np
import pytest
from flint import arb
from long_cases import cases
from places import URDF
from space_chains import chain_file
from space_reference import draw_coefficients, make_record
from space_sharp import BITS, SharpRobot, column, cross, joints, placement, turned

import floatplan as fp
from floatplan.certificate.certificate import capsules_of
from floatplan.certificate.robots.urdf import read_urdf
from floatplan.certificate.spatial import bound
from floatplan.certificate.spatial.attitude import Approximation, approximate
from floatplan.certificate.spatial.findings import angle_between
from floatplan.certificate.spatial.flight import fly
from floatplan.certificate.spatial.models import Matrices, axial, moments
from floatplan.certificate.spatial.obstacles import Surroundings
from floatplan.certificate.spatial.robot import spatial_robot
from floatplan.certificate.spatial.torques import forces
from floatplan.plans.reading import recorded_robot
from floatplan.robot.urdf.tree import urdf_path

GO2 = "example-robot-data:go2_description/urdf/go2.urdf"
ROUNDED = arb(2) ** -150  # what 200 bits leave open
INSTANTS = 10  # of each flight
MOST_SHAPES = 12  # of each robot whose ends are compared
POINT = ([0.7, -1.1, 2.3], [0.4, 0.1, -0.3])  # [m], [m/s] one that moves, in the world


def drawn(name, folder):
    rng = np.random.default_rng(len(name))
    if name == "chain":
        robot = fp.Robot.from_urdf(chain_file(folder, 12, 3), base="free-flyer")
        return make_record(
            robot, draw_coefficients(rng, 12, 1.0, 0.3), 1.0, [1.0, 2.0, -0.5], ("l0", "l12"), instants=3
        )
    if name == "diver":
        robot = fp.Robot.from_urdf(URDF / "diver.urdf", base="free-flyer")
        return make_record(
            robot, draw_coefficients(rng, 7, 1.4, 0.4), 1.4, [3.0, 50.0, 1.0], ("feet", "feet"), instants=3
        )
    robot = fp.Robot.from_urdf(GO2, base="free-flyer")
    b = draw_coefficients(rng, 12, 0.6, 0.3)
    return make_record(robot, b, 0.6, [0.3, 2.0, -0.2], ("FL_foot", "FR_foot"), instants=3)


class Compared:
    """Counts values, and those outside."""

    def __init__(self):
        self.values = 0
        self.outside = []

    def entries(self, what, model, cell, u, truth):
        """One matrix (p, q): each entry within its radius, and all together within theirs in the Frobenius norm."""
        square = arb(0)
        for i, j in np.ndindex(*model.c.shape[3:]):
            off = truth[i, j] - flint.arb_poly(model.c[cell, 0, :, i, j].tolist())(u)
            square += off * off
            self.that(what, abs(off), model.entries[cell, 0, i, j])
        spectral = square.sqrt() if model.c.shape[4] == 1 else square.sqrt() / arb(3).sqrt()
        self.that(f"norm of {what}", spectral, model.e[cell, 0])

    def scalars(self, what, model, cell, u, truth):
        for k, value in enumerate(truth):
            self.that(what, abs(value - flint.arb_poly(model.c[:, cell, k].tolist())(u)), model.e[cell, k])

    def that(self, what, off, radius):
        self.values += 1
        if not off <= arb(float(radius)):
            self.outside.append((what, float(off), float(radius)))


@pytest.mark.parametrize("name", cases(["go2", "diver", "chain"], {"go2", "diver"}))
def test_nothing_lies_outside_its_enclosure(name, tmp_path):
    record = drawn(name, tmp_path)
    compared = enclosed(record, INSTANTS, np.random.default_rng(1))
    print(f"{name}: {len(compared.outside)} of {compared.values} values are outside")  # pytest -rP shows it
    assert not compared.outside
    assert compared.values > 100 * INSTANTS


def enclosed(record, instants, rng):
    """Compare all models at so many instants of a flight."""
    path = urdf_path(record.robot.file)
    robot = spatial_robot(read_urdf(path.read_bytes(), path), record.robot)
    momentum = np.array(record.angular_momentum)
    start = np.array(record.orientation["start"]["quaternion_xyzw"])
    with np.errstate(all="ignore"):
        flight = fly(robot, record, (), 4096)
        cells, motion = flight.cells, flight.motion
        approximation = approximate(motion, cells, momentum, start, flight.quaternions[:, 0])
        approximated = bound._approximated(approximation, cells, momentum)
        residuals = bound.attitude_bound(motion, approximation, cells, momentum, start).residuals
        found = forces(robot, motion, approximated.momentum_in_base)
        shapes = capsules_of(recorded_robot(record.robot)) if robot.with_collision else None
        surroundings = Surroundings(robot, record, flight, shapes, None)
        segments = surroundings.segments[:MOST_SHAPES]
        moving = surroundings.from_com_in_base(*POINT)
        in_world = surroundings.to_base.transposed @ segments.start
    compared = Compared()
    with flint.ctx.workprec(BITS):
        sharp = SharpRobot(path, record.robot.joints)
        h = column(" ".join(map(repr, momentum.tolist())))
        for cell, point in zip(rng.integers(0, len(cells), instants), rng.uniform(-1, 1, instants), strict=True):
            u = arb(float(point))
            low, high = arb(float(cells.low[cell])), arb(float(cells.high[cell]))
            t = (low + high) / 2 + (high - low) / 2 * u
            q, dq, ddq = joints(record, t)
            for what, truth in (("positions", q), ("velocities", dq), ("accelerations", ddq)):
                compared.scalars(what, getattr(motion, what), cell, u, truth)
            inertia = sharp.inertia(q)
            relative = sharp.momentum(q, dq, column("0 0 0"))
            compared.entries("inertia", motion.inertia, cell, u, inertia)
            compared.entries("inverse", motion.inverse, cell, u, inertia.inv())
            compared.entries("relative", motion.joint_momentum, cell, u, relative)
            polynomials = [flint.arb_poly(column.tolist()) for column in approximation.quaternions[cell].T]
            quaternion = [polynomial(u) for polynomial in polynomials]
            attitude = turned(quaternion)
            seen = attitude.transpose() * h
            compared.entries("attitude", approximated.attitudes, cell, u, attitude)
            compared.entries("seen", approximated.momentum_in_base, cell, u, seen)
            omega = inertia.solve(seen - relative)
            compared.entries("rate", found.rate, cell, u, omega)
            compared.scalars("torque", found.motor_torques, cell, u, sharp.torques(q, dq, ddq, omega))
            slopes = [polynomial.derivative()(u) * 2 / (high - low) for polynomial in polynomials]
            rates = turning(quaternion, slopes)
            compared.entries("rates", approximated.rates, cell, u, rates)
            off = rates - omega
            compared.that("residual", sum((part * part for part in off.entries()), arb(0)).sqrt(), residuals[cell])
            place = moving_point(record, t)
            compared.entries("moving point", moving, cell, u, attitude.transpose() * place)
            for item, (start, along) in enumerate(ends_of_shapes(sharp, robot, shapes, q)[:MOST_SHAPES]):
                compared.entries("start", segments.start[[item]], cell, u, start)
                compared.entries("along", segments.along[[item]], cell, u, along)
                compared.entries("start in the world", in_world[[item]], cell, u, attitude * start)
    return compared


def moving_point(record, t):
    """``POINT`` from the centre of mass, in the world's axes."""
    com = record.com
    start, rate = (
        arb_column(one) - arb_column(other)
        for one, other in zip(POINT, (com["position0"], com["velocity0"]), strict=True)
    )
    return start + rate * t + arb_column([0.0, 0.0, com["gravity"]]) * (t * t / 2)


def arb_column(numbers):
    return flint.arb_mat(3, 1, [arb(float(number)) for number in numbers])


def ends_of_shapes(sharp, robot, shapes, q):
    """Starts of the shapes from the centre of mass, and what is along them, in the base's axes, in the same order."""
    zero = [arb(0)] * len(q)
    still = column("0 0 0")
    motions = sharp._motions(q, zero, zero, still, still)
    middle = sharp._center(list(sharp._bodies(motions)), 2)
    if shapes is not None:
        local = [(link, arb_column(start), arb_column(end)) for link, start, end, _ in shapes]
    else:
        local = []
        for link in robot.segments:
            children = [joint for joint in sharp.joints.values() if joint.find("parent").get("link") == link]
            ends = [placement(joint)[1] for joint in children] or [still]
            local += [(link, still, end) for end in ends]
    found = []
    for link, start, end in local:
        rotation, place = motions[link][:2]
        found.append((place + rotation * start - middle, rotation * (end - start)))
    return found


def turning(q, dq):
    """``2 vec(Q* Q') / |Q|^2``."""
    v, dv = (column("0 0 0") + flint.arb_mat(3, 1, each[:3]) for each in (q, dq))
    square = sum((part * part for part in q), arb(0))
    return (dv * q[3] - v * dq[3] - cross(v, dv)) * (2 / square)


def random_matrices(rng, rows, columns, radius=0.0, decay=0.5):
    c = rng.uniform(-1, 1, (2, 3, 16, rows, columns)) * decay ** np.arange(16)[:, None, None]
    return Matrices.of(c, np.full((2, 3, rows, columns), radius))


def value(model, cell, item, u):
    c = model.c[cell, item]
    rows, columns = c.shape[1:]
    return flint.arb_mat([[flint.arb_poly(c[:, i, j].tolist())(u) for j in range(columns)] for i in range(rows)])


def assert_contains(model, truth):
    with flint.ctx.workprec(BITS):
        for cell, item in np.ndindex(*model.e.shape):
            for point in (-1.0, -0.77, 0.0, 0.3, 1.0):
                off = truth(cell, item, arb(point)) - value(model, cell, item, arb(point))
                for i, j in np.ndindex(*model.c.shape[3:]):
                    assert abs(off[i, j]) <= arb(float(model.entries[cell, item, i, j])) + ROUNDED
                square = (off.transpose() * off).tolist()
                mean = sum(abs(row[k]) for k, row in enumerate(square)) / len(square)  # no more than the norm's square
                radius = arb(float(model.e[cell, item])) + ROUNDED
                assert mean <= radius * radius


def moment_of(z):
    return flint.arb_mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]]) * (z[0, 0] + z[1, 1] + z[2, 2]) - z.transpose()


@pytest.mark.parametrize("decay", [0.9, 0.5, 0.05])
def test_operations_contain_the_exact_result(decay):
    rng = np.random.default_rng(3)
    a, b = random_matrices(rng, 3, 3, decay=decay), random_matrices(rng, 3, 3, decay=decay)
    assert_contains(a @ b, lambda *k: value(a, *k) * value(b, *k))
    assert_contains(a + b, lambda *k: value(a, *k) + value(b, *k))
    assert_contains(a - b, lambda *k: value(a, *k) - value(b, *k))
    assert_contains(a.transposed, lambda *k: value(a, *k).transpose())
    assert_contains(a.summed(), lambda cell, _, u: sum((value(a, cell, i, u) for i in range(3)), flint.arb_mat(3, 3)))

    def vector(*k):
        z = value(a, *k)
        return flint.arb_mat(3, 1, [z[1, 2] - z[2, 1], z[2, 0] - z[0, 2], z[0, 1] - z[1, 0]])

    assert_contains(moments(a), lambda *k: moment_of(value(a, *k)))
    assert_contains(axial(a), vector)


@pytest.mark.parametrize("shift", [-1, 1])
def test_radii_of_the_operands_are_carried(shift):
    """Operands shifted by their radii: the results contain what follows."""
    rng = np.random.default_rng(4)
    a, b = random_matrices(rng, 3, 3, 1e-3), random_matrices(rng, 3, 3, 2e-3)

    def moved(model, radius):
        return lambda *k: value(model, *k) + flint.arb_mat([[arb(shift * radius)] * 3] * 3)

    assert_contains(a @ b, lambda *k: moved(a, 1e-3)(*k) * moved(b, 2e-3)(*k))
    assert_contains(a.widened(np.full((2, 3), 1e-3)), moved(a, 1e-3))
    assert_contains(moments(a), lambda *k: moment_of(moved(a, 1e-3)(*k)))


def test_the_largest_product_of_neighbours_is_bounded():
    rng = np.random.default_rng(5)
    sequence = np.eye(3) + 0.3 * rng.normal(size=(30, 3, 3))
    true = 0.0
    for first in range(30):
        product = np.eye(3)
        for factor in sequence[first:]:
            product = factor @ product
            true = max(true, np.linalg.norm(product, 2))
    spectral, frobenius = bound._largest_product(sequence)
    assert true <= spectral <= 1.05 * true
    assert spectral <= frobenius * (1 + 1e-9)


@pytest.mark.parametrize("size", [0.0, 1e-16, 1e-12, 1e-3])
def test_steps_between_cells_are_those_of_200_bits(size):
    """Of any lengths and signs of the quaternions: never less, and hardly more, than the angles between them."""
    rng = np.random.default_rng(1)
    cells = 40
    q = rng.normal(size=(cells, 16, 4)) * 0.2 ** np.arange(16)[:, None]
    powers = (-1.0) ** np.arange(16)
    for cell in range(1, cells):  # each begins where the one before ended, but for a little
        target = q[cell - 1].sum(axis=0) * rng.choice([-1.0, 1.0]) * rng.choice([1.0, 1.0 + 1e-9])
        q[cell, 0] += target - powers @ q[cell] + size * rng.normal(size=4)
    start = powers @ q[0]
    found = bound._steps(Approximation(q, np.zeros((cells, 16, 3, 3))), start)
    with flint.ctx.workprec(BITS):
        ends = [[exact_sum(column) for column in cell.T] for cell in q]
        begins = [[exact_sum(column * powers) for column in cell.T] for cell in q]
        before = [[arb(part) for part in start.tolist()], *ends[:-1]]
        true = [float(angle_between(*pair).upper()) for pair in zip(begins, before, strict=True)]
    assert (found >= true).all()
    assert (found <= 1.02 * np.array(true) + 1e-30).all()


def exact_sum(numbers):
    return sum((arb(number) for number in numbers.tolist()), arb(0))
