"""A reference motion for learning: a whole jump, 50 frames a second, with the velocities that it truly has.

Policies that imitate are given motions to follow; one that is planned is within the robot's limits, stands where it
says, and is proved in the air. The file is for Isaac Lab's AMP: joints, links and contacts by name. Readers of
positions alone differentiate them, and round off what is fast, such as the push before takeoff: the crosses. Other
formats are `motion-csv` and `loco-mujoco`; `floatplan study --export` writes a library. Needs the extra `jump`.
"""

import sys
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/reference_motion")

jump = fp.jump(HERE.parent / "problems" / "jumps" / "gymnast.toml")
assert jump.flight is not None, jump.explanation
print(f"flight {fp.certify(jump.flight).verdict}; {jump.explanation}")
with np.load(jump.export("isaac-amp", OUT / "gymnast.npz", rate=50), allow_pickle=False) as file:
    motion = dict(file)
names, fps = motion["dof_names"].tolist(), int(motion["fps"])
times = np.arange(len(motion["dof_positions"])) / fps
print(f"{len(times)} frames, {fps} a second, joints {', '.join(names)}, links {', '.join(motion['body_names'])}")
for key in ("dof_velocities", "dof_torques", "body_rotations", "body_angular_velocities", "contacts", "contact_forces"):
    print(f"  {key:24} {motion[key].shape}")

exact = motion["dof_velocities"]
differences = np.gradient(motion["dof_positions"], times, axis=0)
rounded = np.abs(differences - exact).max()
print(f"differences of positions are off by up to {rounded:.2f} of {np.abs(exact).max():.2f} rad/s")

(flight,) = (phase for phase in jump.phases if not phase.contacts)
fine = np.linspace(0.0, jump.duration, 1000)
moving = jump.v(fine)[:, -len(names) :]
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure(figsize=(7.0, 3.4))
    for index, (axes, name) in enumerate(zip(figure.subplots(1, 2), names, strict=True)):
        axes.axvspan(flight.begin, flight.end, color="#eeeeee", label="in the air")
        axes.plot(fine, moving[:, index], color="#aaaaaa", label="the jump's")
        axes.plot(times, exact[:, index], ".", label="in the file")
        axes.plot(times, differences[:, index], "x", markersize=4, label="differences of positions")
        axes.set(title=name, xlabel="time (s)", ylabel="velocity (rad/s)", xlim=(0.6, 1.8))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    figure.savefig(OUT / "reference_motion.png")
