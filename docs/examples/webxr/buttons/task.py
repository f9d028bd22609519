"""What the page with the buttons is worth: a point for every button, a little for coming closer."""

from __future__ import annotations

import numpy as np

from sim2vr_harness.client import Measure, Outcome, Task, TaskMoment


class Buttons(Task):
    """Touch the button that is lit."""

    description = "touch the lit one of three buttons"
    values = {
        "pressed": "app.pressed",
        "low": "app.low",
        "middle": "app.middle",
        "high": "app.high",
        "lit": "app.lit.position",
    }
    measures = (
        Measure("pressed", "Pressed", better="higher", digits=1, log_key="pressed"),
        Measure("low", "Low", digits=1, log_key="low"),
        Measure("middle", "Middle", digits=1, log_key="middle"),
        Measure("high", "High", digits=1, log_key="high"),
    )
    score = "pressed"
    round_seconds = 20.0
    devices = ("controller_right",)

    def reset(self, moment: TaskMoment, seed: int) -> None:
        """Begin a round."""
        self.pressed = moment.number("pressed")

    def step(self, moment: TaskMoment) -> Outcome:
        """Reward a press with 10, and being near the lit button with up to 1 a second."""
        new = moment.number("pressed") - self.pressed
        self.pressed = moment.number("pressed")
        gap_m = float(np.linalg.norm(moment.position("right_controller") - moment.place("lit")))
        near = float(np.exp(-10.0 * gap_m)) * moment.step_s
        return Outcome(10.0 * new + near, log={"presses": new, "near": near, "gap_m": gap_m})
