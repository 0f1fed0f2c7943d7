"""``floatplan certify`` and ``floatplan replay``: whether a plan holds, by proof and by forward dynamics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

import floatplan as fp
from floatplan.cli.common import Json, PlanFile, Save, Urdf, finish
from floatplan.cli.progress import progress
from floatplan.errors import InputError


def certify(
    plan_file: PlanFile,
    urdf: Urdf = None,
    budget: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Most intervals of time to examine; fewer may decide less.")
    ] = None,
    save: Save = False,
    json_output: Json = False,
) -> None:
    """Prove that a plan holds at every instant, not only at sampled ones. Exit code 0 only where proved."""
    with progress("proving"):
        certificate = fp.certify(plan_file, urdf=urdf, **({} if budget is None else {"budget": budget}))
    facts = certificate.to_dict()
    if save:
        from floatplan.plans.reading import load_record

        load_record(plan_file).with_checks(certificate=facts).save(plan_file)
    finish(facts, json_output, lambda summary: summary.certificate_summary(certificate), certificate.proved)


def replay(
    plan_file: PlanFile,
    urdf: Urdf = None,
    engine: Annotated[str, typer.Option(metavar="NAME", help="'pinocchio' (the default) or 'mujoco'.")] = "pinocchio",
    perturb: Annotated[
        str,
        typer.Option(
            metavar="h=1%,..",
            help="Errors of h at takeoff, of mass, of torque: h=1%,mass=2%,torque=1%; with --replan of "
            "h, inertia, torque, rise, noise, delay: h=10%,inertia=5%,noise=0.1deg,delay=5ms if left out.",
        ),
    ] = "",
    feedback: Annotated[
        float | None,
        typer.Option(metavar="RAD/S", help="Bandwidth of joint feedback; left out, open loop, 100 with --replan."),
    ] = None,
    step: Annotated[float, typer.Option(metavar="S", help="Longest step of MuJoCo, s.")] = 5e-4,
    replan: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="Correct in flight, so often a second: many flights, with and without."),
    ] = None,
    flights: Annotated[int, typer.Option(min=1, metavar="N", help="Number of flights with --replan.")] = 20,
    budget: Annotated[
        float, typer.Option(metavar="S", help="Time after which no more is flown with --replan, s.")
    ] = 60.0,
    seed: Annotated[int, typer.Option(min=0, help="Of their errors and noise.")] = 0,
    authority: Annotated[
        bool, typer.Option("--authority", help="Tell from which errors corrections still land, and until when.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Put flights.html, with its pictures, into this folder."),
    ] = None,
    save: Save = False,
    json_output: Json = False,
) -> None:
    """Fly a plan by forward dynamics under its torques. Exit code 1 where that misses the goal, undisturbed.

    With --replan, fly it many times with errors, corrected in flight and not. With --authority, tell how much can be
    corrected.
    """
    from floatplan.simulation.forward import check_engine

    checked = check_engine(engine)
    plan = fp.load_plan(plan_file, urdf)
    if replan is not None or authority:
        if save:
            raise InputError("keeps an undisturbed replay only", element="--save", advice="leave it out")
        given = {"flights": flights, "budget": budget, "seed": seed, "feedback": feedback, "perturb": perturb or None}
        _fly_many(plan, replan, authority, output, json_output, engine=checked, **given)
    if output is not None:
        raise InputError("is for --replan and --authority", element="--output", advice="add one of them")
    with progress("flying"):
        flown = fp.replay(plan, engine=checked, perturb=perturb, feedback=feedback, step=step, seed=seed)
    facts = flown.to_dict()
    if save:
        plan.record.with_checks(replay=facts).save(plan_file)
    finish(facts, json_output, lambda summary: summary.replay_summary(flown), flown.landed or flown.disturbed)


def _fly_many(
    plan: fp.Plan, rate: float | None, with_authority: bool, output: Path | None, json_output: bool, **options: Any
) -> NoReturn:
    """Fly with and without corrections where there is a rate, tell how much can be corrected where asked, and print.

    ``options`` are those of :func:`floatplan.closed_loop`; None is left to it.
    """
    from floatplan.cli.results import check_directory

    if output is not None:
        check_directory(output)
    given = {name: value for name, value in options.items() if value is not None}
    flown = None if rate is None else fp.closed_loop(plan, rate, **given)
    found = fp.authority(plan) if with_authority else None
    page = None
    if output is not None:
        from floatplan.view.report.flights import write_flights_page

        page = write_flights_page(plan, output / "flights.html", flown, found)
    facts: dict[str, Any] = {} if flown is None else flown.to_dict()
    facts |= {} if found is None else {"authority": found.to_dict()}
    finish(facts, json_output, lambda summary: summary.flights_summary(flown, found, page))
