"""A clip that cannot fly, and its repair: a backflip whose flight is played too slowly, as retargeted jumps mostly are.

The clip is made here: a whole jump of the gymnast, 50 frames a second, its flight 1.4 times as long as it was. In it
the centre of mass falls at g / 1.4², which no torque can do; `check_clip` says so. `repair_clip` plans the flight anew,
nearest to the clip, and brings the stances to meet it. "retime" keeps postures and heights; "raise" keeps the clip's
time instead, so that the robot rises higher. Needs the extra `jump`.
"""

import sys
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/repair_a_clip")
FPS, SLOWER = 50, 1.4

jump = fp.jump(HERE.parent / "problems" / "jumps" / "gymnast.toml")
(flight,) = (phase for phase in jump.phases if not phase.contacts)
longer = (SLOWER - 1) * (flight.end - flight.begin)
times = np.arange(int((jump.duration + longer) * FPS)) / FPS
of_clip = [0, flight.begin, flight.end + longer, jump.duration + longer]
of_jump = [0, flight.begin, flight.end, jump.duration]
OUT.mkdir(parents=True, exist_ok=True)
np.savetxt(OUT / "clip.csv", jump.q(np.interp(times, of_clip, of_jump)), delimiter=",")

clip = fp.load_clip(OUT / "clip.csv", model=jump.robot.path, fps=FPS, quaternion="xyzw")
shown = {"the clip": clip}
for choice in ("retime", "raise"):
    repaired, told = fp.repair_clip(clip, choice)
    shown[choice] = repaired
    (done,) = told.table()
    print(f"{choice}: {done['duration_before']:.2f} s become {done['duration_after']:.2f} s, joints", end=" ")
    print(f"{np.rad2deg(done['joints_rms']):.2f} degrees off")

with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure(figsize=(7.0, 3.2))
    axes = figure.subplots()
    for name, each in shown.items():
        (judged,) = fp.check_clip(each).flights
        print(f"{name}: {judged.verdict}, falls at {judged.fall.fall:.2f} m/s^2")
        label = f"{name}: falls at {judged.fall.fall:.2f} m/s²"
        axes.plot(judged.fall.times, judged.fall.places[:, 2], ".-", label=label)
    axes.set(xlabel="time (s)", ylabel="height of the centre of mass (m)")
    axes.legend()
    figure.savefig(OUT / "repair_a_clip.png")
