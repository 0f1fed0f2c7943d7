"""``floatplan certify`` and ``floatplan replay``: whether a plan holds, by proof and by forward dynamics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from floatplan.cli.common import DONE, FAILED, Json, PlanFile, Save, Urdf, print_json, reporting_errors
from floatplan.cli.progress import progress
from floatplan.errors import InputError


@reporting_errors
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
    from floatplan.certificate.certificate import BUDGET
    from floatplan.certificate.certificate import certify as prove
    from floatplan.plans.reading import load_record

    with progress("proving"):
        certificate = prove(plan_file, urdf=urdf, budget=budget or BUDGET)
    facts = certificate.to_dict()
    if save:
        load_record(plan_file).with_checks(certificate=facts).save(plan_file)
    if json_output:
        print_json(facts)
    else:
        from floatplan.cli.summary import certificate_summary, print_summary

        print_summary(certificate_summary(certificate))
    raise typer.Exit(DONE if certificate.proved else FAILED)


@reporting_errors
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
    from floatplan.plans.plan import load_plan
    from floatplan.simulation.replay import check_engine
    from floatplan.simulation.replay import replay as fly

    checked = check_engine(engine)
    plan = load_plan(plan_file, urdf)
    if replan is not None or authority:
        from floatplan.cli.inflight import fly_many

        if save:
            raise InputError("keeps an undisturbed replay only", element="--save", advice="leave it out")
        given = {"flights": flights, "budget": budget, "seed": seed, "feedback": feedback, "perturb": perturb or None}
        fly_many(plan, replan, authority, output, json_output, engine=checked, **given)
        raise typer.Exit(DONE)
    if output is not None:
        raise InputError("is for --replan and --authority", element="--output", advice="add one of them")
    with progress("flying"):
        flown = fly(plan, engine=checked, perturb=perturb, feedback=feedback, step=step, seed=seed)
    facts = flown.to_dict()
    if save:
        plan.record.with_checks(replay=facts).save(plan_file)
    if json_output:
        print_json(facts)
    else:
        from floatplan.cli.summary import print_summary, replay_summary

        print_summary(replay_summary(facts))
    raise typer.Exit(DONE if flown.landed or flown.disturbed else FAILED)
