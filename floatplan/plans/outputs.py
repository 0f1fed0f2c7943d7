"""Pictures, pages and other formats of a motion, by its methods: they lie in upper rooms."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from floatplan.arguments import flag, function, optional, positive, text
from floatplan.arguments import path as as_path
from floatplan.plans.trajectory import MotionSample, Trajectory, sample_times, sampled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Loaded by name when they are called: only here does a lower package call upper ones.
OUTPUTS = {
    "figures": "floatplan.view.figures.figures",
    "animate": "floatplan.view.figures.animation",
    "write_report": "floatplan.view.report.report",
    "notebook_frame": "floatplan.view.report.report",
    "export": "floatplan.export.formats",
}


class Outputs:
    """What every motion, a plan or a jump, can be shown and written as."""

    def refuse_unless_shown(self) -> None:
        """Raise InputError where there is no motion that pictures could show."""

    def sample(self: Trajectory, rate: float) -> MotionSample:
        """Return the motion at even instants, from its beginning to its end, which is always the last.

        Parameters
        ----------
        rate : float
            Instants per second, Hz.

        Raises
        ------
        InputError
            The rate is not positive and finite, or gives more than 100 000 instants; as of :meth:`at`; or a joint is
            called ``root_joint``, as Pinocchio calls the free flyer.
        """
        rate = positive(unit="Hz")(rate, "rate")
        return sampled(self, sample_times(self.duration, rate))

    def figures(self) -> dict[str, Figure]:
        """Return the figures by name, as matplotlib figures; see :func:`floatplan.view.figures.figures.figures`."""
        self.refuse_unless_shown()
        figure: dict[str, Figure] = output("figures")(self)
        return figure

    def animate(
        self, path: str | Path = "flight.gif", *, speed: float = 0.5, progress: Callable[[int, int], None] | None = None
    ) -> Path:
        """Write a film of the motion, ``.gif`` or ``.mp4``, and return its path.

        ``speed`` 0.5 is slow motion; ``progress`` is called with how many pictures are finished, and of how many.
        """
        path = as_path(path, "path")
        speed = positive()(speed, "speed")
        progress = optional(function)(progress, "progress")
        self.refuse_unless_shown()
        return Path(output("animate")(self, path, speed=speed, progress=progress))

    def show(self, path: str | Path = "report.html", *, browse: bool = True) -> Path:
        """Write the report, a page that plays the motion, and open it in the browser unless ``browse`` is false."""
        browse = flag(browse, "browse")
        path = as_path(path, "path")
        self.refuse_unless_shown()
        page = Path(output("write_report")(self, path))
        if browse:
            webbrowser.open(page.resolve().as_uri())
        return page

    def export(
        self,
        form: str,
        path: str | Path | None = None,
        rate: float | None = None,
        *,
        kp: Any = None,
        kd: Any = None,
        model: str | Path | None = None,
    ) -> Path:
        """Write the motion in another format.

        Parameters
        ----------
        form : str
            "csv", "csv-full", "parquet", "npz", "pinocchio", "mujoco", "ros", "mcap", "unitree", "unitree-sdk",
            "isaac-amp", "motion-csv", "loco-mujoco", "unitree-csv", "mjlab-npz", "gmr" or "mimickit"; see
            ``floatplan export --help``.
        path : path, optional
            The file; left out, the format's own name in the working directory. What "motion-csv", "unitree-csv" and
            "loco-mujoco" cannot hold, velocities and contacts, goes next to it, as ``motion.extras.npz``.
        rate : float, optional
            Instants per second, Hz; left out, what suits the format.
        kp, kd : float or mapping, optional
            Gains of the joints, N m/rad and N m s/rad, of all or by name, in files that have them.
        model : path, optional
            URDF or MJCF of what reads a reference motion ("isaac-amp" and those after it), or flies it ("mujoco"):
            the file has its joints, bodies and actuators, in its order. Left out, "mujoco" is for the MJCF
            that the robot was read from.

        Raises
        ------
        InputError
            The format is unknown, or has no gains or for the order of a model; a number is wrong; the model
            has other joints or bodies than the robot; or there is no motion.
        """
        path = optional(as_path)(path, "path")
        rate = optional(positive(unit="Hz"))(rate, "rate")
        model = optional(as_path)(model, "model")
        return Path(output("export")(self, text(form, "format"), path, rate, kp=kp, kd=kd, model=model))

    def _repr_html_(self) -> str:
        """The report, as notebooks show it: it plays."""
        self.refuse_unless_shown()
        return str(output("notebook_frame")(self))


def output(name: str) -> Callable[..., Any]:
    """Return a function of :data:`OUTPUTS`."""
    function: Callable[..., Any] = getattr(import_module(OUTPUTS[name]), name)
    return function
