"""How far MuJoCo's integrators let a jump's angular momentum drift in flight, where nothing changes it.

    floatplan jump problems/jumps/go2.toml
    python scripts/momentum_drift.py runs/go2_backflip/jump.json

The jump is flown as ``floatplan replay`` flies it, once by each integrator. From the last contact to the next the
angular momentum about the centre of mass is the same in truth; printed is how much it changes, as a share of what it is
then, and by how much the base would be turned less or more at the end of the flight.
"""

import argparse
import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from floatplan.jumps.reading import load_jump
from floatplan.simulation import jump_run
from floatplan.simulation.contact.model import ContactRobot
from floatplan.simulation.contact.tracked_motion import PERIOD
from floatplan.simulation.gains import gains_of_jump
from floatplan.simulation.mujoco_model import STEP
from floatplan.simulation.perturbation import given_perturbation

INTEGRATORS = ("IMPLICITFAST", "IMPLICIT", "RK4", "EULER")
WHEN = 0.02  # [s] into the flight: from then on all feet are in the air


def flown(jump: Any, integrator: str, step: float) -> list[tuple[float, float, bool]]:
    """Time, s, angular momentum about the plane's normal, kg m^2/s, and whether anything touches, at each tick."""
    rows: list[tuple[float, float, bool]] = []

    class Recorded(ContactRobot):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            self.model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
            self.model.opt.timestep = step

        def move(self, torques: Any, duration: float) -> bool:
            moved = super().move(torques, duration)
            mujoco.mj_subtreeVel(self.model, self.data)
            momentum = float(self.data.subtree_angmom[1] @ self.robot.plane.normal)
            rows.append((self.data.time, momentum, bool(self.data.ncon)))
            return moved

    vars(jump_run)["ContactRobot"] = Recorded
    control = jump_run.JumpControl(jump, gains_of_jump(jump), None)
    control.run_jump(given_perturbation(""), jump.request.friction, seed=0, number=0, correct=False)
    return rows


def main() -> None:
    """Print a line for each integrator and step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("jump", type=Path, help="jump.json")
    jump = load_jump(parser.parse_args().jump)
    assert jump.flight is not None  # as load_jump saw
    begin, duration = jump.takeoff_time, jump.flight.duration
    inertia = np.abs(jump.flight.angular_momentum) / np.abs(jump.flight.problem.final.orientation) * duration
    for step in (STEP, STEP / 4):
        for integrator in INTEGRATORS:
            rows = [row for row in flown(jump, integrator, step) if begin + WHEN < row[0] < begin + duration]
            in_air = [momentum for _, momentum, touches in rows if not touches]
            drift = (max(in_air) - min(in_air)) / abs(in_air[0])
            turned = math.degrees(abs(np.mean(in_air) - in_air[0]) * len(in_air) * PERIOD / inertia)
            print(
                f"{integrator:13} {step:.3g} s  h {in_air[0]:.5g}, drift {100 * drift:.2g} %, turned {turned:.2g} deg"
            )


if __name__ == "__main__":
    main()
