"""Old names of commands, which work in this version and name the new command."""

from __future__ import annotations

from sim2vr_harness.cli import curves, endurance, film, motor, snapshot
from sim2vr_harness.cli.command import CommandGroup


def add_old_names(app: CommandGroup) -> None:
    """Add the hidden old commands to the command line."""
    app.add_old("curves", curves.curves, "plot curves")
    app.add_old("snapshot", snapshot.snapshot, "render snapshot")
    app.add_old("endurance", endurance.endurance, "users endurance")
    app.add_old("film", film.film, "render film")
    group = CommandGroup("Old names of `sim2vr-harness users motor`.")
    group.add_old("practise", motor.train_layer, "users motor train")
    group.add_old("measure", motor.measure, "users motor measure")
    app.add_typer(group, name="motor", hidden=True)
